"""A fleet by the name of its backend."""

from typing import Any

from auv_torchrl.envs.fleet import FleetEnv
from auv_torchrl.envs.mujoco_fleet import MujocoFleet
from auv_torchrl.envs.torch_fleet import TorchFleet
from auv_torchrl.tasks import Task
from auv_torchrl.vehicle import Vehicle

BACKENDS: dict[str, type[MujocoFleet] | type[TorchFleet]] = {"mujoco": MujocoFleet, "torch": TorchFleet}


def make_fleet(backend: str, vehicle: Vehicle, task: Task, num_envs: int, **options: Any) -> FleetEnv:
    """A fleet of that backend; ``options`` as its constructor takes them.

    Raises:
        ValueError: for an unknown backend, naming those there are.
    """
    if backend not in BACKENDS:
        raise ValueError(f"no backend named {backend!r}: there are {', '.join(BACKENDS)}")
    return BACKENDS[backend](vehicle, task, num_envs, **options)
