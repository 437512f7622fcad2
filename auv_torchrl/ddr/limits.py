"""The command within limits whose effect comes nearest to what is wanted."""

import torch
from torch import Tensor, nn

RIDGE = 1e-4  # picks the smallest of several commands with the same effect; costs 0.04 % of it on six thrusters
STIFFNESS = 1.5  # penalty of the splitting, relative to the mean curvature; 1 to 3 converge in about 20 rounds


class LimitedInverse(nn.Module):
    """Minimise ``|W a - tau|^2`` over ``low <= rows a <= high``, for m maps W (m, 4, k).

    Where the unlimited minimiser lies within the limits it is the answer; otherwise a fixed number of rounds of
    the alternating direction method of multipliers (Boyd et al. 2011, section 5.2) goes to the nearest point of
    the reachable set. Unlike clipping, the nearest point never reverses what is wanted.
    """

    free: Tensor  # (m, k, 4)
    onward: Tensor  # (m, k, k)
    pull: Tensor  # (m, k, 4)
    penalty: Tensor  # (m, 1)
    rows: Tensor
    low: Tensor
    high: Tensor

    def __init__(self, weight: Tensor, rows: Tensor, low: Tensor, high: Tensor, rounds: int = 20):
        super().__init__()
        m, tau, k = weight.shape
        self.rounds = rounds
        for name, value in (("rows", rows), ("low", low), ("high", high)):
            self.register_buffer(name, value.clone(), persistent=False)
        for name, shape in (("free", (m, k, tau)), ("onward", (m, k, k)), ("pull", (m, k, tau)), ("penalty", (m, 1))):
            self.register_buffer(name, torch.zeros(shape))
        self.set_weight(weight)

    @torch.no_grad()
    def set_weight(self, weight: Tensor) -> None:
        """Invert new maps (m, 4, k)."""
        wide = weight.double()
        rows = self.rows.double()
        gram = wide.mT @ wide
        eye = torch.eye(gram.shape[-1], dtype=gram.dtype, device=gram.device)
        size = gram.diagonal(dim1=-2, dim2=-1).sum(-1)[:, None, None].clamp_min(1e-12)
        self.free.copy_(torch.linalg.solve(gram + RIDGE * eye, wide.mT))
        penalty = STIFFNESS * size / (rows * rows).sum()
        self.onward.copy_(torch.linalg.inv(gram + penalty * (rows.mT @ rows) + RIDGE * eye))
        self.pull.copy_(wide.mT)
        self.penalty.copy_(penalty[:, :, 0])

    def forward(self, tau: Tensor) -> Tensor:
        """Commands (N, k) for wanted effects (N, 4); m is 1 or N."""
        a = _product(self.free, tau)
        rows = self.rows.mT
        if bool((((a @ rows) <= self.high) & ((a @ rows) >= self.low)).all()):
            return a
        wanted = _product(self.pull, tau)
        z = (a @ rows).clamp(self.low, self.high)
        u = torch.zeros_like(z)
        for _ in range(self.rounds):
            a = _product(self.onward, wanted + self.penalty * ((z - u) @ self.rows))
            reached = a @ rows
            z = (reached + u).clamp(self.low, self.high)
            u = u + reached - z
        return self.shrink(a)

    def shrink(self, a: Tensor) -> Tensor:
        """The longest multiple (at most 1) of commands (N, k) within the limits."""
        reached = a @ self.rows.mT
        excess = torch.where(reached > 0, reached / self.high.clamp_min(1e-9), reached / self.low.clamp_max(-1e-9))
        return a / excess.amax(-1, keepdim=True).clamp_min(1.0)


def _product(matrix: Tensor, vector: Tensor) -> Tensor:
    """(1 or N, i, j) times (N, j)."""
    if matrix.shape[0] == 1:
        return vector @ matrix[0].mT
    return (matrix @ vector[..., None])[..., 0]
