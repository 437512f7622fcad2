"""A vehicle as SDF for Gazebo: one link with the hydrodynamics plugin, and a joint with the thruster plugin each.

Gazebo's world has z up and its bodies front, left, up: y and z change their sign. Its plugins take added mass and drag
as derivatives, which are negative.
"""

import xml.etree.ElementTree as ET

import numpy as np

from auv_torchrl.export.marks import Described
from auv_torchrl.export.mjcf import left_out
from auv_torchrl.vehicle import Vehicle
from auv_torchrl.vehicle.fields import GRAVITY, WATER_DENSITY

FLIP = np.array((1.0, -1.0, -1.0))  # from front, right, down to front, left, up
SYMBOLS = (("x", "U"), ("y", "V"), ("z", "W"), ("k", "P"), ("m", "Q"), ("n", "R"))  # force and speed of each axis
_PROPELLER_KG, _PROPELLER_M = 0.01, 0.076  # a T200's; the mass only has to be there


def sdf(described: Described) -> str:
    """The model as XML. The world needs the Buoyancy system with a density of 1000 kg/m^3."""
    vehicle = described.vehicle
    root = ET.Element("sdf", version="1.9")
    marked = ("mass", "added_mass", "linear_drag", "quadratic_drag", "full_thrust")
    words = [
        f"{described.name}, written by auv-export from {described.source}; not tried in Gazebo",
        *described.remarks,
    ]
    for name in marked:
        words.append(f"{name}: {'; '.join(dict.fromkeys(map(str, described.marks[name].flatten().tolist())))}")
    words.append(f"left out: {'; '.join(left_out(vehicle)) or 'nothing'}")
    for line in words:
        root.append(ET.Comment(f" {line.replace('--', '- -')} "))
    model = ET.SubElement(root, "model", name=described.name)
    _add_link(vehicle, model)
    _add_hydrodynamics(vehicle, described.added_mass, model)
    for number in range(1, vehicle.thrusters + 1):
        _add_thruster(vehicle, model, described.name, number)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _put(parent: ET.Element, name: str, *values: float) -> None:
    ET.SubElement(parent, name).text = " ".join(f"{float(value) + 0.0:.9g}" for value in values)


def _add_link(vehicle: Vehicle, model: ET.Element) -> None:
    """Mass and inertia, and a hull of the volume that is displaced, at the centre of buoyancy."""
    link = ET.SubElement(model, "link", name="base_link")
    inertial = ET.SubElement(link, "inertial")
    _put(inertial, "pose", *(FLIP * vehicle.centre_of_mass), 0, 0, 0)
    _put(inertial, "mass", vehicle.mass - vehicle.thrusters * _PROPELLER_KG)
    inertia = ET.SubElement(inertial, "inertia")
    for name, value in zip(("ixx", "iyy", "izz"), vehicle.inertia, strict=True):
        _put(inertia, name, value)
    for name in ("ixy", "ixz", "iyz"):
        _put(inertia, name, 0.0)
    side = (float(vehicle.buoyancy - vehicle.vertical_force) / (WATER_DENSITY * GRAVITY)) ** (1 / 3)
    for kind in ("collision", "visual"):
        part = ET.SubElement(link, kind, name=f"hull_{kind}")
        _put(part, "pose", *(FLIP * vehicle.centre_of_buoyancy), 0, 0, 0)
        _put(ET.SubElement(ET.SubElement(part, "geometry"), "box"), "size", side, side, side)


def _add_hydrodynamics(vehicle: Vehicle, added_mass: np.ndarray, model: ET.Element) -> None:
    plugin = ET.SubElement(
        model, "plugin", filename="gz-sim-hydrodynamics-system", name="gz::sim::systems::Hydrodynamics"
    )
    ET.SubElement(plugin, "link_name").text = "base_link"
    for axis, (force, speed) in enumerate(SYMBOLS):
        _put(plugin, f"{force}Dot{speed}", -added_mass[axis])
        _put(plugin, f"{force}{speed}", -vehicle.linear_drag[axis, axis])
        _put(plugin, f"{force}{speed}abs{speed}", -vehicle.quadratic_drag[axis])


def _add_thruster(vehicle: Vehicle, model: ET.Element, name: str, number: int) -> None:
    """A propeller on a joint along its thrust; its command is N, on /model/<name>/joint/thruster_n_joint/cmd_thrust."""
    n = number - 1
    link = ET.SubElement(model, "link", name=f"thruster_{number}")
    _put(link, "pose", *(FLIP * vehicle.thruster_position[n]), 0, 0, 0)
    inertial = ET.SubElement(link, "inertial")
    _put(inertial, "mass", _PROPELLER_KG)
    inertia = ET.SubElement(inertial, "inertia")
    for entry in ("ixx", "iyy", "izz"):
        _put(inertia, entry, 1e-5)
    joint = ET.SubElement(model, "joint", name=f"thruster_{number}_joint", type="revolute")
    ET.SubElement(joint, "parent").text = "base_link"
    ET.SubElement(joint, "child").text = f"thruster_{number}"
    axis = ET.SubElement(joint, "axis")
    _put(axis, "xyz", *(FLIP * vehicle.thruster_direction[n]))
    plugin = ET.SubElement(model, "plugin", filename="gz-sim-thruster-system", name="gz::sim::systems::Thruster")
    ET.SubElement(plugin, "namespace").text = name
    ET.SubElement(plugin, "joint_name").text = f"thruster_{number}_joint"
    _put(plugin, "thrust_coefficient", 0.02)
    _put(plugin, "fluid_density", WATER_DENSITY)
    _put(plugin, "propeller_diameter", _PROPELLER_M)
    most = min(vehicle.full_thrust[n], vehicle.limit[n])
    _put(plugin, "max_thrust_cmd", most)
    _put(plugin, "min_thrust_cmd", -min(vehicle.full_thrust[n] * (1 - vehicle.asymmetry[n]), vehicle.limit[n]))
