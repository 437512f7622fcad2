"""The look of a BlueROV2-like vehicle, from MuJoCo primitives; sizes from Blue Robotics' drawings, in m, FRD."""

import math
from typing import Any

from auv_torchrl.vehicle import Vehicle

COLOURS = {
    "frame": (0.07, 0.08, 0.10, 1),
    "float": (0.05, 0.36, 0.70, 1),
    "tube": (0.80, 0.93, 0.97, 0.28),
    "inside": (0.13, 0.30, 0.20, 1),
    "metal": (0.66, 0.69, 0.72, 1),
    "duct": (0.04, 0.04, 0.05, 1),
    "propeller": (0.16, 0.55, 0.80, 1),
    "lamp": (1.0, 0.97, 0.80, 1),
    "tether": (0.98, 0.80, 0.12, 1),
}
X_AXIS, Y_AXIS = (0.0, 0.7071068, 0.0, 0.7071068), (0.7071068, -0.7071068, 0.0, 0.0)  # turn z to x, z to y


def add_look(body: Any, vehicle: Vehicle) -> None:
    """Add frame, floats, tubes, lamps, tether and the thrusters of ``vehicle`` at their poses to an MJCF body."""

    def add(material: str, kind: str, size: tuple[float, ...], pos: tuple[float, float, float], **more: Any) -> None:
        body.add("geom", type=kind, material=material, size=size, pos=pos, **more)

    for side in (-1, 1):
        add("frame", "box", (0.225, 0.006, 0.022), (0.0, side * 0.166, -0.045))  # upper rail
        add("frame", "box", (0.225, 0.006, 0.022), (0.0, side * 0.166, 0.105))  # lower rail
        for x in (-0.2, 0.0, 0.2):
            add("frame", "box", (0.024, 0.006, 0.07), (x, side * 0.166, 0.03))
        add("metal", "capsule", (0.008, 0.215), (0.0, side * 0.166, 0.133), quat=X_AXIS)  # skid
        for x in (-0.125, 0.125):
            add("float", "box", (0.092, 0.052, 0.026), (x, side * 0.112, -0.094))
            add("float", "capsule", (0.026, 0.085), (x, side * 0.164, -0.094), quat=X_AXIS)
            add("float", "capsule", (0.026, 0.085), (x, side * 0.060, -0.094), quat=X_AXIS)
        add("metal", "cylinder", (0.021, 0.026), (0.205, side * 0.105, 0.075), quat=X_AXIS)  # lamp
        add("lamp", "cylinder", (0.018, 0.003), (0.233, side * 0.105, 0.075), quat=X_AXIS)
    for x in (-0.21, 0.21):
        add("frame", "box", (0.006, 0.166, 0.02), (x, 0.0, 0.105))
    add("frame", "box", (0.16, 0.166, 0.004), (0.0, 0.0, 0.052))  # cradle
    add("inside", "box", (0.115, 0.032, 0.004), (-0.01, 0.0, 0.008))  # electronics tray
    add("metal", "box", (0.05, 0.022, 0.014), (-0.04, 0.0, -0.01))
    add("metal", "cylinder", (0.058, 0.010), (-0.165, 0.0, 0.0), quat=X_AXIS)  # end cap
    add("metal", "cylinder", (0.058, 0.008), (0.145, 0.0, 0.0), quat=X_AXIS)
    add("duct", "sphere", (0.021,), (0.155, 0.0, 0.0))  # camera
    add("lamp", "sphere", (0.007,), (0.173, 0.0, 0.0))
    add("tube", "cylinder", (0.057, 0.152), (-0.008, 0.0, 0.0), quat=X_AXIS)
    add("tube", "ellipsoid", (0.055, 0.055, 0.055), (0.150, 0.0, 0.0))  # dome
    add("frame", "cylinder", (0.044, 0.115), (0.0, 0.0, 0.098), quat=X_AXIS)  # battery
    add("metal", "cylinder", (0.045, 0.008), (0.118, 0.0, 0.098), quat=X_AXIS)
    add("metal", "cylinder", (0.045, 0.008), (-0.118, 0.0, 0.098), quat=X_AXIS)
    hanging = (
        (-0.17, 0.0, -0.03), (-0.26, 0.01, -0.05), (-0.36, 0.03, -0.12), (-0.46, 0.05, -0.25),
        (-0.54, 0.06, -0.44), (-0.60, 0.06, -0.70), (-0.64, 0.05, -1.05), (-0.66, 0.03, -1.60),
    )  # fmt: skip
    for start, end in zip(hanging, hanging[1:], strict=False):
        body.add("geom", type="capsule", material="tether", fromto=(*start, *end), size=(0.0045,))
    poses = zip(vehicle.thruster_position.tolist(), vehicle.thruster_direction.tolist(), strict=True)
    for number, (position, direction) in enumerate(poses, 1):
        _add_thruster(body.add("body", name=f"thruster_{number}", pos=position, zaxis=direction))


def _add_thruster(body: Any, radius: float = 0.043, segments: int = 20) -> None:
    """A ducted propeller whose force at a positive command points along the body's z axis."""
    for index in range(segments):
        angle = 2 * math.pi * index / segments
        place = (radius * math.cos(angle), radius * math.sin(angle), 0.0)
        width = 1.1 * radius * math.tan(math.pi / segments)
        body.add(
            "geom", type="box", material="duct", size=(0.0035, width, 0.020), pos=place, euler=(0, 0, angle)
        )  # fmt: skip
    body.add("geom", type="capsule", material="duct", size=(0.014, 0.026), pos=(0, 0, -0.008))
    for index in range(3):
        angle = 2 * math.pi * index / 3 + 0.4
        place = (0.026 * math.cos(angle), 0.026 * math.sin(angle), 0.008)
        body.add(
            "geom", type="ellipsoid", material="propeller", size=(0.016, 0.011, 0.0025), pos=place,
            euler=(0.5, 0, angle),
        )  # fmt: skip
    for angle in (0.0, math.pi / 2):
        body.add(
            "geom", type="box", material="duct", size=(0.042, 0.003, 0.003), pos=(0, 0, -0.014), euler=(0, 0, angle)
        )
