"""The bag of the newest pairs (x, tau_t, tau_s), one per map."""

from typing import NamedTuple

import torch
from torch import Tensor, nn


class Pairs(NamedTuple):
    """Tensors (m, n, ...), and which of the n entries count."""

    state: Tensor  # (m, n, s) x
    control: Tensor  # (m, n, k) tau_t
    source: Tensor  # (m, n, 4) tau_s = R(x, x')
    filled: Tensor  # (m, n) bool


def bag_size(weights: int, cap: int) -> int:
    """n_b = n_p^2 / 2 pairs for a map of n_p weights (Lu et al. 2023, section 4.1), capped."""
    return min(weights * weights // 2, cap)


class Bag(nn.Module):
    """Ring buffers of ``size`` pairs for m maps; everything is in ``state_dict``."""

    state: Tensor
    control: Tensor
    source: Tensor
    filled: Tensor
    head: Tensor  # (m,) where the next pair goes

    def __init__(self, maps: int, size: int, states: int, controls: int, channels: int):
        super().__init__()
        self.size = size
        for name, length in (("state", states), ("control", controls), ("source", channels)):
            self.register_buffer(name, torch.zeros(maps, size + 1, length))  # the last entry takes what is left out
        self.register_buffer("filled", torch.zeros(maps, size + 1, dtype=torch.bool))
        self.register_buffer("head", torch.zeros(maps, dtype=torch.long))

    @property
    def count(self) -> Tensor:
        """Number of pairs in each bag, (m,)."""
        return self.filled.sum(-1)

    def pairs(self) -> Pairs:
        """Everything in the bags."""
        return Pairs(*(getattr(self, name)[:, : self.size] for name in Pairs._fields))

    def push(self, pairs: Pairs) -> None:
        """Put in the pairs (m, r, ...) that count, newest last; the oldest fall out."""
        new = Pairs(*(field[:, -self.size :] for field in pairs))
        order = new.filled.cumsum(-1)
        place = torch.where(new.filled, (self.head[:, None] + order - 1) % self.size, self.size)
        for name in ("state", "control", "source"):
            field = getattr(self, name)
            field.scatter_(1, place[..., None].expand(*place.shape, field.shape[-1]), getattr(new, name))
        self.filled.scatter_(1, place, True)
        self.filled[:, self.size] = False
        self.head.add_(order[:, -1]).remainder_(self.size)

    def empty(self, which: Tensor) -> None:
        """Forget the pairs of some maps, mask (m,)."""
        self.filled.masked_fill_(which[:, None], False)
        self.head.masked_fill_(which, 0)
