"""A vehicle as MJCF: one free body that MuJoCo flies without any code of ours.

MuJoCo has the rigid body, added inertia in rotation and weight as they are. Linear drag is an actuator at the body's
site whose force falls with the speed along its axis. Quadratic drag is MuJoCo's own fluid force, which depends on the
box that has a body's inertia: bodies of almost no mass have the boxes that give the six coefficients. Added mass
differs by direction and MuJoCo's mass does not, so that surge, sway and heave share their mean.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterator

import numpy as np

from auv_torchrl.export.marks import Described
from auv_torchrl.physics import prepare
from auv_torchrl.physics.coefficients import allocation_matrix, total_mass_matrix
from auv_torchrl.vehicle import Vehicle
from auv_torchrl.vehicle.fields import DEGREES_OF_FREEDOM, GRAVITY, WATER_DENSITY

SLIGHT = 1e-6  # kg, of bodies that stand for forces
PLATES = 16  # for each axis: smaller ones resist a turn less
PADDLE, THIN = 2.0, 1e-5  # m, length of what resists a turn, and thickness
_ROUNDS = 50  # of the search for plates and paddles, each of which gives a little of what the others do
_HULL = (0.23, 0.17, 0.13)  # m, half sizes of what is shown
Box = tuple[float, float, float]


def mjcf(described: Described) -> str:
    """The model as XML, in a world whose z points up; the axes of the body are front, right, down."""
    vehicle = described.vehicle
    root = ET.Element("mujoco", model=described.name)
    for line in (*described.remarks, *remarks(described)):
        root.append(ET.Comment(f" {line.replace('--', '- -')} "))
    ET.SubElement(root, "option", timestep="0.005", integrator="RK4", gravity=f"0 0 {-GRAVITY}",
                  density=f"{WATER_DENSITY:g}", viscosity="0")  # fmt: skip
    world = ET.SubElement(root, "worldbody")
    # Turned about x: down in the body is down in the world.
    body = ET.SubElement(world, "body", name="vehicle", pos="0 0 0", quat="0 1 0 0", gravcomp="1")
    ET.SubElement(body, "freejoint", name="vehicle")
    mass, centre, inertia = inertial(vehicle)
    ET.SubElement(body, "inertial", mass=_text(mass), pos=_text(*centre),
                  fullinertia=_text(*inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]))  # fmt: skip
    ET.SubElement(body, "geom", name="hull", type="box", size=_text(*_HULL), contype="0", conaffinity="0", mass="0",
                  rgba="0.1 0.4 0.7 0.4")  # fmt: skip
    # Where a body has an ellipsoid for the water, its inertia has no box for it; this one is too small for any force.
    ET.SubElement(body, "geom", name="no_box", type="sphere", size="1e-5", contype="0", conaffinity="0", mass="0",
                  fluidshape="ellipsoid", fluidcoef="0 0 0 0 0")  # fmt: skip
    ET.SubElement(body, "site", name="body")
    actuators = ET.SubElement(root, "actuator")
    _add_thrusters(vehicle, body, actuators)
    _add_weights(vehicle, body)
    for number, box in enumerate(boxes(vehicle.quadratic_drag)):
        drag = ET.SubElement(body, "body", name=f"quadratic_drag_{number}")
        ET.SubElement(drag, "inertial", mass=_text(SLIGHT), pos="0 0 0", diaginertia=_text(*_box_inertia(box)))
    for axis, (name, drag) in enumerate(zip(DEGREES_OF_FREEDOM, np.diag(vehicle.linear_drag), strict=True)):
        if drag:
            gear = np.eye(6)[axis]
            ET.SubElement(actuators, "general", name=f"linear_drag_{name}", site="body", gear=_text(*gear),
                          biastype="affine", biasprm=_text(0, 0, -drag))  # fmt: skip
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def remarks(described: Described) -> Iterator[str]:
    """What is in the model, what is not, and where its numbers come from."""
    vehicle = described.vehicle
    yield f"{described.name}, written by auv-export from {described.source}"
    yield "ctrl of thruster_n: its thrust in N; the others are drag, and take none"
    mass = np.diag(total_mass_matrix(vehicle))[:3]
    yield f"mass with added mass is {_text(*mass)} kg in surge, sway, heave; here it is their mean, {mass.mean():.6g}"
    names = ("mass", "added_mass", "linear_drag", "quadratic_drag", "buoyancy", "centre_of_buoyancy", "full_thrust")
    for name in names:
        kinds = dict.fromkeys(str(mark) for mark in described.marks[name].flatten().tolist())
        yield f"{name}: {'; '.join(kinds)}"
    yield f"left out: {'; '.join(('added mass that differs by direction', *left_out(vehicle)))}"


def left_out(vehicle: Vehicle) -> Iterator[str]:
    """What a model of thrusts in N and of drag in each degree of freedom does not have."""
    if np.count_nonzero(vehicle.linear_drag - np.diag(np.diag(vehicle.linear_drag))):
        yield "linear drag between degrees of freedom"
    if vehicle.drag_asymmetry.any():
        yield "drag that differs by direction"
    if vehicle.coriolis != 1:
        yield f"Coriolis terms of {float(vehicle.coriolis):g}: here they are whole"
    if vehicle.delay:
        yield f"a delay of {float(vehicle.delay):g} s"
    if (vehicle.exponent != 1).any() or vehicle.asymmetry.any() or vehicle.dead_band.any():
        yield (
            f"the thrust curve: a command c gives full |c|^{vehicle.exponent.mean():.3g} N, backwards "
            f"{100 * vehicle.asymmetry.mean():.3g} % less, below {vehicle.dead_band.mean():.3g} N nothing"
        )
    if vehicle.air:
        yield "the surface of the water"


def inertial(vehicle: Vehicle) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre (3,) and inertia (3, 3) about it, of the rigid body with the water that moves along."""
    total = np.asarray(total_mass_matrix(vehicle))
    mass = float(np.diag(total)[:3].mean())
    coupling = total[3:, :3] / mass  # of the body's own centre: skew symmetric
    skew = coupling - coupling.T
    centre = 0.5 * np.array((skew[2, 1], skew[0, 2], skew[1, 0]))
    about = total[3:, 3:] - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    return mass, centre, about


def boxes(quadratic: np.ndarray) -> list[Box]:
    """Sizes of boxes whose fluid forces add up to quadratic drag (6,).

    MuJoCo resists a box (a, b, c) with rho/2 b c v^2 along a, and rho/64 a (b^4 + c^4) w^2 about a.
    """
    asked, wanted = np.array(quadratic, dtype=float), np.array(quadratic, dtype=float)
    made: list[Box] = []
    for _ in range(_ROUNDS):
        made = [*_plates(asked[:3]), *_paddles(asked[3:])]
        given = np.sum([_resistance(box) for box in made], axis=0) if made else np.zeros(6)
        asked = np.maximum(asked + wanted - given, 0.0)
    return made


def _plates(asked: np.ndarray) -> Iterator[Box]:
    for axis, drag in enumerate(asked):
        side = np.sqrt(2.0 * drag / WATER_DENSITY / PLATES)
        if side > 10 * THIN:
            size = np.full(3, side)
            size[axis] = THIN
            yield from [(float(size[0]), float(size[1]), float(size[2]))] * PLATES


def _paddles(asked: np.ndarray) -> Iterator[Box]:
    for axis, drag in enumerate(asked):
        width = 64.0 * drag / WATER_DENSITY / PADDLE**4
        if width > 0:
            size = np.zeros(3)
            size[[axis, (axis + 1) % 3, (axis + 2) % 3]] = width, PADDLE, THIN
            yield float(size[0]), float(size[1]), float(size[2])


def _resistance(box: Box) -> np.ndarray:
    a, b, c = box
    linear = 0.5 * WATER_DENSITY * np.array((b * c, c * a, a * b))
    turning = WATER_DENSITY / 64 * np.array((a * (b**4 + c**4), b * (c**4 + a**4), c * (a**4 + b**4)))
    return np.concatenate((linear, turning))


def _box_inertia(box: Box) -> np.ndarray:
    a, b, c = box
    return SLIGHT / 12 * np.array((b * b + c * c, c * c + a * a, a * a + b * b))


def _add_weights(vehicle: Vehicle, body: ET.Element) -> None:
    """Weight and buoyancy, each at its place, as the gravity of slight bodies: the hull itself is weightless."""
    up = float(vehicle.buoyancy - vehicle.vertical_force)
    for name, place, down in (
        ("weight", vehicle.centre_of_mass, float(vehicle.mass) * GRAVITY),
        ("buoyancy", vehicle.centre_of_buoyancy, -up),
    ):
        part = ET.SubElement(body, "body", name=name, pos=_text(*place), gravcomp=_text(1 - down / (SLIGHT * GRAVITY)))
        ET.SubElement(part, "inertial", mass=_text(SLIGHT), pos="0 0 0", diaginertia=_text(*(1e-12,) * 3))


def _add_thrusters(vehicle: Vehicle, body: ET.Element, actuators: ET.Element) -> None:
    wrench = np.asarray(allocation_matrix(vehicle)).T
    coefficients = prepare(vehicle)
    for number, row in enumerate(wrench, start=1):
        n = number - 1
        most = float(min(vehicle.full_thrust[n], vehicle.limit[n]))
        least = -float(min(vehicle.full_thrust[n] * (1 - vehicle.asymmetry[n]), vehicle.limit[n]))
        ET.SubElement(body, "site", name=f"thruster_{number}", pos=_text(*vehicle.thruster_position[n]))
        lag = float(coefficients.lag[n])
        motor = ET.SubElement(actuators, "general", name=f"thruster_{number}", site="body", gear=_text(*row),
                              ctrllimited="true", ctrlrange=_text(least, most))  # fmt: skip
        if lag > 0:
            motor.attrib |= {"dyntype": "filterexact", "dynprm": _text(lag)}


def _text(*values: float) -> str:
    return " ".join(f"{float(value):.16g}" for value in values)
