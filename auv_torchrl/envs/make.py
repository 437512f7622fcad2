"""A fleet by the name of its backend."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from auv_torchrl.envs.fleet import FleetEnv
    from auv_torchrl.tasks import Task
    from auv_torchrl.vehicle import Vehicle

# The class of each, imported when a fleet is made: the command line needs the names alone.
BACKENDS = {
    "mujoco": ("auv_torchrl.envs.mujoco_fleet", "MujocoFleet"),
    "torch": ("auv_torchrl.envs.torch_fleet", "TorchFleet"),
}


def make_fleet(backend: str, vehicle: "Vehicle", task: "Task", num_envs: int, **options: Any) -> "FleetEnv":
    """A fleet of that backend; ``options`` as its constructor takes them.

    Raises:
        ValueError: for an unknown backend, naming those there are.
    """
    if backend not in BACKENDS:
        raise ValueError(f"no backend named {backend!r}: there are {', '.join(BACKENDS)}")
    module, name = BACKENDS[backend]
    return getattr(import_module(module), name)(vehicle, task, num_envs, **options)
