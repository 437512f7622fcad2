"""The fleet on the plain torch model: large batches, GPUs, gradients."""

import torch

from auv_torchrl.envs.fleet import FleetEnv, vehicles_of
from auv_torchrl.scenario import Scenario
from auv_torchrl.simulator import PlainSimulator, TorchArrays
from auv_torchrl.tasks import Task
from auv_torchrl.vehicle import Vehicle


class TorchFleet(FleetEnv):
    """Vehicles in a :class:`PlainSimulator` on torch, in the precision of ``dtype``.

    Args:
        vehicle: one nominal vehicle or a batch of ``num_envs``.
        task: what is observed, rewarded and where episodes start.
        num_envs: number of vehicles N.
        scenario: effects on top of each vehicle, by episode time; None for none.
        seed: of starts and sensor noise; None draws one.
        device: of the tensors and the physics.
        dtype: of the physics and the true state; the observation and the reward are float32.
        compiled: compile the physics, see :class:`PlainSimulator`.

    Raises:
        ValueError: for no vehicles, or a batch of vehicles that is not one per environment.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        task: Task,
        num_envs: int,
        scenario: Scenario | None = None,
        seed: int | None = None,
        device: torch.device | str = "cpu",
        dtype: torch.dtype = torch.float32,
        compiled: bool = False,
    ) -> None:
        vehicles, arrays = vehicles_of(vehicle, num_envs), TorchArrays(torch.device(device), dtype)
        simulator = PlainSimulator(vehicles, task.control_dt, scenario=scenario, arrays=arrays, compiled=compiled)
        super().__init__(simulator, task, seed, dtype)
