"""What is remembered between control steps: numpy arrays that are buffers of a module."""

from typing import Any

import torch
from torch import nn

Array = Any


class Memory(nn.Module):
    """A module that remembers numpy arrays, so that ``state_dict`` carries them by itself.

    What was given to :meth:`remember` reads as a numpy array, and assigning another one replaces it. Arrays stay on the
    CPU in their own type wherever the module is moved to: for the few numbers of one vehicle numpy is three times as
    fast as torch, and covariances need float64.
    """

    def remember(self, **arrays: Array) -> None:
        """Keep arrays under these names from now on."""
        for name, values in arrays.items():
            self.register_buffer(name, torch.from_numpy(values))

    def __getattr__(self, name: str) -> Any:
        """The numpy array of that name, which shares its memory with the buffer, or what a module has."""
        value: Any = super().__getattr__(name)
        return value.numpy() if name in self._buffers else value

    def __setattr__(self, name: str, value: Any) -> None:
        """Replace a remembered array."""
        if name in self.__dict__.get("_buffers", ()):
            self._buffers[name] = torch.from_numpy(value)
        else:
            super().__setattr__(name, value)

    def _apply(self, fn: Any, recurse: bool = True) -> Any:
        return self
