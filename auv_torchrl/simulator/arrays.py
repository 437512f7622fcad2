"""Where a simulator's numbers live: numpy arrays, or torch tensors of one precision on one device.

This is the one border between devices: what comes in and what goes out passes through here and through nothing else.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from array_api_compat import array_namespace, is_torch_array
from torch import Tensor

Array = Any


@dataclass(frozen=True)
class NumpyArrays:
    """Numpy in double precision, on the CPU: the fastest for few vehicles, and what MuJoCo works with."""

    device: torch.device = torch.device("cpu")

    def native(self, values: Any) -> np.ndarray:
        """A copy of a tensor or numpy array in double precision."""
        return np.array(torch.as_tensor(values).detach().cpu().numpy(), dtype=np.float64)

    def tensor(self, array: np.ndarray, dtype: torch.dtype) -> Tensor:
        """A copy of an array of the simulator on the device."""
        return torch.tensor(array, dtype=dtype, device=self.device)

    def index(self, rows: Tensor) -> np.ndarray:
        """Row numbers as an index of the simulator's arrays: as they are."""
        return rows.numpy()


@dataclass(frozen=True)
class TorchArrays:
    """Torch on a device: large batches, GPUs."""

    device: torch.device
    dtype: torch.dtype

    def native(self, values: Any) -> Tensor:
        """A copy of a tensor or numpy array on the device, in the precision."""
        return torch.as_tensor(values).to(self.device, self.dtype, copy=True)

    def tensor(self, array: Tensor, dtype: torch.dtype) -> Tensor:
        """The tensor itself where it has that precision."""
        return array.to(dtype)

    def index(self, rows: Tensor) -> Tensor:
        """The row numbers on the device."""
        return rows.to(self.device)


Arrays = NumpyArrays | TorchArrays  # what comes from outside becomes what a simulator works with, and back


def with_rows(array: Array, rows: Array, new: Array) -> Array:
    """A copy of ``array`` (N, ...) whose ``rows`` are ``new``."""
    copy = array.clone() if is_torch_array(array) else array.copy()
    copy[rows] = new
    return copy


def lengthened(memory: Array, length: int) -> Array:
    """The memory (N, L, k), newest first, with at least ``length`` entries; the oldest is repeated."""
    missing = length - memory.shape[1]
    if missing <= 0:
        return memory
    xp = array_namespace(memory)
    return xp.concat((memory, *[memory[:, -1:]] * missing), axis=1)
