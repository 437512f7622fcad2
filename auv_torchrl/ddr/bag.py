"""The bag of the newest pairs (x, tau_t, tau_s)."""

from typing import NamedTuple

import torch
from torch import Tensor, nn


class Pairs(NamedTuple):
    """Of n transitions."""

    state: Tensor  # (n, s) x
    control: Tensor  # (n, k) tau_t
    source: Tensor  # (n, a) tau_s = R(x, x')


def bag_size(weights: int, cap: int) -> int:
    """n_b = n_p^2 / 2 pairs for a map of n_p weights (Lu et al. 2023, section 4.1), capped."""
    return min(weights * weights // 2, cap)


class Bag(nn.Module):
    """A ring buffer of ``size`` pairs; everything is in ``state_dict``."""

    state: Tensor
    control: Tensor
    source: Tensor
    pushed: Tensor  # () how many pairs were put in since it was empty

    def __init__(self, size: int, states: int, controls: int, channels: int):
        super().__init__()
        self.size = size
        for name, length in zip(Pairs._fields, (states, controls, channels), strict=True):
            self.register_buffer(name, torch.zeros(size, length))
        self.register_buffer("pushed", torch.zeros((), dtype=torch.long))

    @property
    def count(self) -> int:
        """Number of pairs in the bag."""
        return min(int(self.pushed), self.size)

    def pairs(self) -> Pairs:
        """Everything in the bag."""
        return Pairs(*(getattr(self, name)[: self.count] for name in Pairs._fields))

    def push(self, pairs: Pairs) -> None:
        """Put in pairs, newest last; the oldest fall out."""
        new = Pairs(*(field[-self.size :] for field in pairs))
        place = (self.pushed + torch.arange(len(new.state), device=self.pushed.device)) % self.size
        for name, field in new._asdict().items():
            getattr(self, name)[place] = field
        self.pushed += len(new.state)

    def empty(self) -> None:
        """Forget all pairs."""
        self.pushed.zero_()
