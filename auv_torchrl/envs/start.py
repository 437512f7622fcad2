"""What a fleet begins with, and what a policy may know of it: what is measured, or what a map that predicts expects."""

from typing import Any

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.data import Composite, Unbounded

from auv_torchrl.authority import check_control
from auv_torchrl.tasks import Task, cruise_speed, fitted
from auv_torchrl.vehicle import Vehicle
from auv_torchrl.vehicle.tensors import vehicle_of

BODY = {"position": 3, "quaternion": 4, "velocity": 6}  # entries of a start, with their lengths
ALONG = "along"  # s along the task: of a start, where it begins; of a report, where the vehicle is
TIME = "time"
VEHICLE = "vehicle"  # of what a reset is given: parameters of the vehicles by name
MEASURED = "measured"  # the fleet's report of position, quaternion and velocity
EXPECTED = "expected"  # by a map that predicts: the same when the next command acts, and ``time`` then


def vehicles_of(vehicle: Vehicle, num_envs: int, task: Task) -> tuple[Vehicle, Task]:
    """One vehicle per environment, from one nominal vehicle or a batch, and the task as its first vehicle can fly it.

    Raises:
        ValueError: for no vehicles, a batch of vehicles that is not one per environment, or thrusters that cannot push
            what the task needs.
    """
    if num_envs < 1:
        raise ValueError(f"fleet: num_envs is {num_envs}: give 1 or more")
    if vehicle.batch_size not in ((), (num_envs,)):
        raise ValueError(f"fleet: the vehicle has batch {list(vehicle.batch_size)}: give one vehicle or {num_envs}")
    first = vehicle.reshape(-1)[0]  # the others are drawn around the same
    task = fitted(task, first)
    check_control(first, task.name, task.needs, not task.thruster_commands, speed=cruise_speed(task))
    return vehicle.expand(num_envs), task


def read_start(start: TensorDictBase | None, rows: Tensor) -> tuple[Tensor, ...]:
    """Checked position, quaternion, velocity and s along the task (0 if not given) of the rows that are reset, float64.

    Raises:
        ValueError: for a missing entry, a wrong shape, values that are not finite or no unit quaternion.
    """
    if start is None:
        raise ValueError(f"fleet: set_state=True needs a 'start' entry with {', '.join(BODY)}")
    parts = []
    given = {ALONG: torch.zeros(*start.batch_size, 1), **dict(start.items())}
    for key, length in (*BODY.items(), (ALONG, 1)):
        value = given.get(key)
        if value is None or value.shape[-1:] != (length,):
            found = "missing" if value is None else f"of shape {list(value.shape)}"
            raise ValueError(f"fleet: start.{key} is {found}: give [num_envs, {length}]")
        value = value.cpu()[rows].double()
        if not value.isfinite().all():
            raise ValueError(f"fleet: start.{key} has values that are not finite")
        parts.append(value)
    if not torch.allclose(parts[1].norm(dim=-1), torch.ones(()).double(), atol=1e-3):
        raise ValueError("fleet: start.quaternion is not of unit length: give w, x, y, z of a rotation")
    parts[1] = torch.nn.functional.normalize(parts[1], dim=-1)
    return tuple(parts)


def reset_spec(vehicle: Vehicle) -> Composite:
    """What a fleet's ``reset`` takes beside its state, of a batch of vehicles on torch: ``vehicle``, in the rows reset.

    No step carries the parameters along: there are some 300 numbers of each vehicle. They are float64 on the CPU,
    whatever device the fleet is on.
    """
    fields = {name: Unbounded(field.shape, dtype=torch.float64, device="cpu") for name, field in vehicle.items()}
    return Composite({VEHICLE: Composite(fields, shape=vehicle.batch_size)}, shape=vehicle.batch_size)


def read_vehicles(entry: TensorDictBase | None, rows: Tensor, declared: Composite) -> Vehicle | None:
    """The vehicles of the rows that are reset, from a ``vehicle`` entry; None without one.

    Raises:
        ValueError: for an entry that is not what is declared, see :func:`reset_spec`.
    """
    if entry is None:
        return None
    both: Any = (declared[VEHICLE], entry)
    wanted, found = ({str(name): part.shape for name, part in each.items()} for each in both)
    if odd := sorted(name for name in wanted.keys() | found.keys() if wanted.get(name) != found.get(name)):
        raise ValueError(f"fleet: reset's entry '{VEHICLE}': missing, unknown or misshapen are {', '.join(odd)}")
    return vehicle_of(entry[rows])


def expected_along(tensordict: TensorDictBase) -> Tensor:
    """How far along the task (N, 1) vehicles will be when the next command acts, s."""
    return tensordict.get(ALONG) + (tensordict.get((EXPECTED, TIME)) - tensordict.get(TIME))


def expected_spec(observation_spec: Composite) -> Composite:
    """Spec of what a map that predicts reports under ``expected``."""
    lengths = {**BODY, TIME: 1}
    like: Any = observation_spec[MEASURED, "position"]
    shape = like.shape[:-1]
    entries = {
        key: Unbounded(torch.Size((*shape, length)), dtype=like.dtype, device=like.device)
        for key, length in lengths.items()
    }
    return Composite(entries, shape=shape, device=like.device)
