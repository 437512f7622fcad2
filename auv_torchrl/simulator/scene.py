"""What a camera sees: one vehicle in blue water, and the target.

The world is NED and the body FRD, as in the fleet's model: light falls along +z and the camera's up is -z.
"""

from typing import Any

import numpy as np

from auv_torchrl.simulator.look import COLOURS, add_look
from auv_torchrl.simulator.mujoco_model import compiled, new_model
from auv_torchrl.vehicle import Vehicle

SIZE = (500, 800)  # pixels, height and width
EYE = (0.68, 0.50, -0.30)  # m, from the vehicle to the camera, in the earth frame
WATER = (0.04, 0.30, 0.42)
TARGET = (1.0, 0.55, 0.08, 1)


class Scene:
    """A vehicle that can be put anywhere and photographed.

    Args:
        vehicle: one vehicle, empty batch; its thrusters stand where they are.

    Raises:
        RuntimeError: if MuJoCo finds no way to draw.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self.physics = compiled(scene_model(vehicle))

    def photograph(
        self,
        position: np.ndarray,
        quaternion: np.ndarray,
        size: tuple[int, int] = SIZE,
        target: np.ndarray | tuple[float, ...] = (0.0, 0.0, 0.0),
    ) -> np.ndarray:
        """RGB image (height, width, 3) uint8 of the vehicle at a position (3,) in m NED and quaternion (4,).

        ``target`` (3,), m, is where the cross stands.
        """
        placed = self.physics.named.data
        placed.mocap_pos["vehicle"], placed.mocap_quat["vehicle"] = position, quaternion
        placed.mocap_pos["target"] = target
        self.physics.forward()
        try:
            return self.physics.render(
                *size,
                camera_id="camera",  # type: ignore[arg-type]  # names are taken as well
                render_flag_overrides={"fog": True, "haze": True},
            )
        except (RuntimeError, ImportError, AttributeError, OSError) as error:
            raise RuntimeError(
                "MuJoCo could not draw: without a display install EGL (libegl1) and leave MUJOCO_GL unset or set it "
                "to egl, or install OSMesa and set MUJOCO_GL=osmesa"
            ) from error


def scene_model(vehicle: Vehicle) -> Any:
    """The MJCF model: water, sea floor, mocap bodies ``target``, a cross, and ``vehicle`` with its camera."""
    model = new_model("scene")
    model.compiler.angle = "radian"
    visual = model.visual
    buffer = getattr(visual, "global")
    buffer.offheight, buffer.offwidth = 1080, 1920
    visual.map.znear, visual.map.zfar, visual.map.fogstart, visual.map.fogend = 0.01, 60, 0.8, 4.5
    visual.rgba.fog = visual.rgba.haze = (*WATER, 1)
    visual.quality.shadowsize, visual.quality.offsamples = 4096, 8
    visual.headlight.ambient, visual.headlight.diffuse = (0.34, 0.38, 0.42), (0.22, 0.24, 0.26)
    add = model.asset.add
    add("texture", name="water", type="skybox", builtin="flat", rgb1=WATER, width=64, height=384)
    add("texture", name="sand", type="2d", builtin="checker", rgb1=(0.22, 0.38, 0.42), rgb2=(0.20, 0.355, 0.40),
        width=256, height=256)  # fmt: skip
    add("material", name="sand", texture="sand", texrepeat=(60, 60))
    for name, colour in {**COLOURS, "target": TARGET}.items():
        add("material", name=name, rgba=colour, specular=0.5, shininess=0.6, emission=0.7 if name == "lamp" else 0.05)
    world = model.worldbody
    world.add("light", pos=(0.5, -0.5, -5), dir=(-0.1, 0.15, 1), diffuse=(0.8, 0.85, 0.85), directional=True)
    world.add("light", pos=(3, 3, -2), dir=(-0.7, -0.5, 0.5), diffuse=(0.3, 0.34, 0.36), directional=True,
              castshadow=False)  # fmt: skip
    world.add("geom", name="floor", type="plane", size=(40, 40, 1), pos=(0, 0, 1.2), zaxis=(0, 0, -1), material="sand")
    target = world.add("body", name="target", mocap=True)
    for name, axis in zip("xyz", np.eye(3), strict=True):
        ends = (*(-0.08 * axis), *(0.08 * axis))
        target.add("geom", name=f"target_{name}", type="capsule", fromto=ends, size=(0.005,), material="target")
    body = world.add("body", name="vehicle", mocap=True)
    add_look(body, vehicle)
    body.add("camera", name="camera", mode="track", pos=EYE, xyaxes=_towards(-np.array(EYE)), fovy=42)
    return model


def _towards(direction: np.ndarray) -> tuple[float, ...]:
    """A camera's x (right) and y (up) axes for a view along ``direction`` with the surface above."""
    forward = direction / np.linalg.norm(direction)
    right = np.cross(forward, (0.0, 0.0, -1.0))
    right /= np.linalg.norm(right)
    return (*right, *np.cross(right, forward))
