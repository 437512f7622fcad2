"""Where a simulator's numbers live: numpy arrays, or torch tensors of one precision on one device.

This is the one border between devices: what comes in and what goes out passes through here and through nothing else.
"""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor

Array = Any


class Arrays(Protocol):
    """Turns what comes from outside into the arrays that a simulator works with, and back."""

    @property
    def device(self) -> torch.device:
        """Of the tensors that come out."""
        ...

    def native(self, values: Any) -> Array:
        """A copy of a tensor or numpy array in the simulator's library, device and precision."""
        ...

    def tensor(self, array: Array, dtype: torch.dtype) -> Tensor:
        """An array of the simulator as a tensor on the device."""
        ...

    def index(self, rows: Tensor) -> Array:
        """Row numbers as an index of the simulator's arrays."""
        ...


@dataclass(frozen=True)
class NumpyArrays:
    """Numpy in double precision, on the CPU: the fastest for few vehicles, and what MuJoCo works with."""

    device: torch.device = torch.device("cpu")

    def native(self, values: Any) -> np.ndarray:
        """A copy in double precision."""
        return np.array(torch.as_tensor(values).detach().cpu().numpy(), dtype=np.float64)

    def tensor(self, array: np.ndarray, dtype: torch.dtype) -> Tensor:
        """A copy on the device."""
        return torch.tensor(array, dtype=dtype, device=self.device)

    def index(self, rows: Tensor) -> np.ndarray:
        """The row numbers as they are."""
        return rows.numpy()


@dataclass(frozen=True)
class TorchArrays:
    """Torch on a device: large batches, GPUs."""

    device: torch.device
    dtype: torch.dtype

    def native(self, values: Any) -> Tensor:
        """A copy on the device."""
        return torch.as_tensor(values).to(self.device, self.dtype, copy=True)

    def tensor(self, array: Tensor, dtype: torch.dtype) -> Tensor:
        """The tensor itself where it has that precision."""
        return array.to(dtype)

    def index(self, rows: Tensor) -> Tensor:
        """The row numbers on the device."""
        return rows.to(self.device)
