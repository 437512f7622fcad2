"""The fleet as one MuJoCo model: N free bodies that only walls can touch. The one file that knows dm-control.

Its mjcf checks elements by a schema and gives named access and rendering; it costs Python 3.13 (labmaze has no wheel
for it). Other files get models and elements from here, so that another builder would change this file alone.

MuJoCo's world is the NED earth frame and its bodies are FRD, literally: there is no gravity in the model, so
that "down" is no more than a name, and no conversion exists that could be wrong.
"""

from typing import Any

import numpy as np
from dm_control import mjcf

from auv_torchrl.array_api import host
from auv_torchrl.physics import SUBSTEPS
from auv_torchrl.physics.coefficients import total_mass_matrix
from auv_torchrl.quantities import counted
from auv_torchrl.vehicle import Vehicle

HULL = (0.23, 0.17, 0.13)  # m, half sizes of the BlueROV2's frame (Blue Robotics drawing)
VEHICLES, WALLS = 1, 2  # contact classes: vehicles touch walls, never each other


def new_model(name: str) -> Any:
    """An empty MJCF model; its elements are typed by a schema at run time."""
    return mjcf.RootElement(model=name)


def compiled(model: Any) -> Any:
    """The model ready to simulate and to render, with named access to its parts.

    Raises:
        ValueError: if it is larger than MuJoCo's tables, as of some 4,000 vehicles.
    """
    try:
        return mjcf.Physics.from_mjcf_model(model)
    except ValueError as error:
        if "allocate memory" not in str(error):
            raise
        count = len(model.find_all("joint"))
        raise ValueError(
            f"fleet: {counted(count, 'vehicle')} are more than one MuJoCo model holds: give fewer, or backend=torch, "
            "which has the same physics for any number"
        ) from error


def fleet_model(
    vehicle: Vehicle, num_envs: int, control_dt: float, walls: tuple[float, float, float] | None = None
) -> Any:
    """``num_envs`` bodies ``vehicle_<row>`` with free joints, integrated by RK4 in steps of control_dt / SUBSTEPS.

    The forces come from outside and contain the vehicle's own inertia. The bodies' mass and isotropic inertia,
    the means over the vehicles and their axes with added mass, matter to contacts alone.

    Args:
        vehicle: the nominal vehicles.
        num_envs: number of bodies.
        control_dt: s, the control step.
        walls: half sizes in m of a tank around the origin, with a floor and an open surface; None for open water.
    """
    model = new_model("fleet")
    model.option.timestep = control_dt / SUBSTEPS
    model.option.integrator = "RK4"
    model.option.gravity = (0.0, 0.0, 0.0)
    flag = model.option.flag
    flag.gravity = flag.autoreset = flag.sensor = flag.actuation = "disable"
    if walls is None:
        flag.contact = flag.constraint = "disable"
    diagonal = np.linalg.diagonal(host(total_mass_matrix(vehicle)))
    mass, inertia = float(diagonal[..., :3].mean()), float(diagonal[..., 3:].mean())
    for row in range(num_envs):
        body = model.worldbody.add("body", name=f"vehicle_{row}")
        body.add("freejoint", name=f"vehicle_{row}")
        body.add("inertial", pos=(0, 0, 0), mass=mass, diaginertia=(inertia,) * 3)
        if walls is not None:
            body.add("geom", name=f"hull_{row}", type="box", size=HULL, contype=VEHICLES, conaffinity=WALLS)
    for name, position, normal in () if walls is None else _sides(*walls):
        model.worldbody.add(
            "geom", name=name, type="plane", size=(20, 20, 1), pos=position, zaxis=normal,
            contype=WALLS, conaffinity=VEHICLES,
        )  # fmt: skip
    return model


def _sides(x: float, y: float, z: float) -> list[tuple[str, tuple, tuple]]:
    return [
        ("north", (x, 0, 0), (-1, 0, 0)),
        ("south", (-x, 0, 0), (1, 0, 0)),
        ("east", (0, y, 0), (0, -1, 0)),
        ("west", (0, -y, 0), (0, 1, 0)),
        ("floor", (0, 0, z), (0, 0, -1)),
    ]
