"""The fleet on the plain torch model: large batches, GPUs, gradients."""

from typing import Any

import torch
from torch import Tensor

from auv_torchrl.envs.fleet import FleetEnv
from auv_torchrl.physics import SUBSTEPS, State, control_step


class TorchFleet(FleetEnv):
    """Vehicles moved by :func:`auv_torchrl.physics.control_step`, in the precision of ``dtype``."""

    def _native(self, tensor: Tensor) -> Tensor:
        return tensor.to(self.device, self.state_dtype, copy=True)

    def _tensor(self, array: Tensor, dtype: torch.dtype) -> Tensor:
        return array.to(dtype)

    def _index(self, rows: Tensor) -> Tensor:
        return rows.to(self.device)

    def _advance(self, command: Any) -> State:
        return control_step(self._coefficients, self._terms, self._state, command, self.task.control_dt, SUBSTEPS)
