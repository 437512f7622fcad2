"""The fleet on the plain torch model: large batches, GPUs, gradients."""

import torch
from torch import Tensor

from auv_torchrl.envs.fleet import FleetEnv
from auv_torchrl.envs.start import vehicles_of
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
        straight_through: let gradients by actions pass limits and dead bands as if these were not there.

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
        straight_through: bool = False,
    ) -> None:
        (vehicles, task), arrays = vehicles_of(vehicle, num_envs, task), TorchArrays(torch.device(device), dtype)
        simulator = PlainSimulator(
            vehicles, task.control_dt, scenario=scenario, arrays=arrays,
            compiled=compiled, straight_through=straight_through,
        )  # fmt: skip
        super().__init__(simulator, task, seed, dtype)
        self._straight_through = straight_through

    def _limited(self, command: Tensor) -> Tensor:
        limited = super()._limited(command)
        return command + (limited - command).detach() if self._straight_through else limited
