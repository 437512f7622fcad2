"""The fleet on the plain torch model: large batches, GPUs, gradients."""

from typing import Any

import torch
from torch import Tensor

from auv_torchrl.envs.fleet import FleetEnv
from auv_torchrl.envs.regulation import RegulationTask
from auv_torchrl.physics import State, control_step
from auv_torchrl.physics.step import runge_kutta_step
from auv_torchrl.scenario import Scenario
from auv_torchrl.vehicle import Vehicle


class TorchFleet(FleetEnv):
    """Vehicles moved by :func:`auv_torchrl.physics.control_step`, in the precision of ``dtype``.

    Args:
        vehicle: one nominal vehicle or a batch of ``num_envs``.
        task: what is observed, rewarded and where episodes start.
        num_envs: number of vehicles N.
        scenario: effects on top of each vehicle, by episode time; None for none.
        seed: of starts and sensor noise; None draws one.
        device: of the tensors and the physics.
        dtype: of the physics and the true state; the observation and the reward are float32.
        compiled: compile the Runge-Kutta step at its first use, some 10 s for each set of active terms; worth it
            for long runs of large fleets. Needs a C++ compiler on the CPU.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        task: RegulationTask,
        num_envs: int,
        scenario: Scenario | None = None,
        seed: int | None = None,
        device: torch.device | str = "cpu",
        dtype: torch.dtype = torch.float32,
        compiled: bool = False,
    ) -> None:
        super().__init__(vehicle, task, num_envs, scenario, seed, device, dtype)
        self._runge_kutta_step = torch.compile(runge_kutta_step, fullgraph=True) if compiled else runge_kutta_step

    def _native(self, tensor: Tensor) -> Tensor:
        return tensor.to(self.device, self.state_dtype, copy=True)

    def _tensor(self, array: Tensor, dtype: torch.dtype) -> Tensor:
        return array.to(dtype)

    def _index(self, rows: Tensor) -> Tensor:
        return rows.to(self.device)

    def _advance(self, command: Any) -> State:
        return control_step(
            self._coefficients,
            self._terms,
            self._state,
            command,
            self.task.control_dt,
            advance=self._runge_kutta_step,
        )
