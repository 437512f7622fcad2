"""Where a simulator's numbers live: numpy arrays, or torch tensors of one precision on one device.

This is the one border between devices: what comes in and what goes out passes through here and through nothing else.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from array_api_compat import array_namespace, is_torch_array

from auv_torchrl.array_api import host

if TYPE_CHECKING:
    import torch

Array = Any


class Arrays(Protocol):
    """What comes from outside becomes what a simulator works with, and back."""

    @property
    def device(self) -> Any:
        """Where tensors of the outside are: a name, or a device of torch."""
        ...

    def native(self, values: Any) -> Array:
        """A copy of a tensor or numpy array, for the simulator."""
        ...

    def tensor(self, array: Array, dtype: Any) -> Any:
        """An array of the simulator as a tensor on the device."""
        ...

    def index(self, rows: np.ndarray) -> Array:
        """Row numbers as an index of the simulator's arrays."""
        ...


@dataclass(frozen=True)
class NumpyArrays:
    """Numpy in double precision, on the CPU: the fastest for few vehicles, and what MuJoCo works with."""

    device: "torch.device | str" = "cpu"

    def native(self, values: Any) -> np.ndarray:
        """A copy of a tensor or numpy array in double precision."""
        return np.array(host(values), dtype=np.float64)

    def tensor(self, array: np.ndarray, dtype: "torch.dtype") -> "torch.Tensor":
        """A copy of an array of the simulator on the device."""
        import torch  # here, not above: who asks for tensors has it

        return torch.tensor(array, dtype=dtype, device=self.device)

    def index(self, rows: np.ndarray) -> np.ndarray:
        """Row numbers as an index of the simulator's arrays: as they are."""
        return rows


@dataclass(frozen=True)
class TorchArrays:
    """Torch on a device: large batches, GPUs."""

    device: "torch.device"
    dtype: "torch.dtype"

    def native(self, values: Any) -> "torch.Tensor":
        """A copy of a tensor or numpy array on the device, in the precision."""
        import torch  # likewise

        if isinstance(values, torch.Tensor):
            return values.to(self.device, self.dtype, copy=True)
        return torch.tensor(values, dtype=self.dtype, device=self.device)

    def tensor(self, array: "torch.Tensor", dtype: "torch.dtype") -> "torch.Tensor":
        """The tensor itself where it has that precision."""
        return array.to(dtype)

    def index(self, rows: np.ndarray) -> "torch.Tensor":
        """The row numbers on the device."""
        import torch  # likewise

        return torch.as_tensor(rows, device=self.device)


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
