"""G and H as affine maps: G(tau_t) = W tau_t + b, and H its inverse within the limits."""

import torch
from torch import Tensor, nn

from auv_torchrl.ddr.actuation import ControlSpace
from auv_torchrl.ddr.allocation import RIDGE
from auv_torchrl.ddr.bag import Pairs


class AffineMap(nn.Module):
    """m affine maps, one for all vehicles or one per vehicle.

    G is fitted to pairs (tau_t, R(x, x')) by Eq. 8 of Lu et al. 2023; the sum of squares has a closed-form
    minimiser. H minimises the cycle loss |H(G(tau_t)) - tau_t| for that G: where W is invertible this is
    tau -> W^-1 (tau - b) exactly, whatever the pairs, and no noise of R enters it a second time. H is never
    the map tau_t -> tau_s itself, which is right only for faults that are their own inverse.

    Args:
        maps: number of maps m.
        space: the commands tau_t.
        ridge: pull towards the healthy map, in pairs of unit size.
    """

    weight: Tensor  # (m, 4, k)
    bias: Tensor  # (m, 4)
    standard_error: Tensor  # (m,) largest standard error of a weight; infinite before the first fit

    def __init__(self, maps: int, space: ControlSpace, ridge: float):
        super().__init__()
        self.space = space
        self.ridge = ridge
        self.register_buffer("weight", space.nominal.expand(maps, -1, -1).clone())
        self.register_buffer("bias", torch.zeros(maps, space.nominal.shape[0]))
        self.register_buffer("standard_error", torch.full((maps,), torch.inf))

    @property
    def weights_per_map(self) -> int:
        """n_p, the number of unknown weights of one G."""
        return self.weight[0].numel() + self.bias[0].numel()

    @property
    def condition(self) -> Tensor:
        """Ratio of the largest to the smallest singular value of W, (m,)."""
        size = torch.linalg.svdvals(self.weight)
        return size[:, 0] / size[:, -1]

    def forward(self, state: Tensor, control: Tensor) -> Tensor:
        """G: what controls (N, r, k) or (m, n, k) do, in source channels of the same shape (..., 4)."""
        return control @ self.weight.mT + self.bias[:, None]

    def invert(self, state: Tensor, tau: Tensor) -> Tensor:
        """H: controls (N, k) within limits whose G comes nearest to ``tau`` (N, 4)."""
        return self.space.nearest(self.weight, tau - self.bias)

    @property
    def unlimited(self) -> Tensor:
        """H without limits and bias, (m, k, 4)."""
        wide = self.weight.double()
        gram = wide.mT @ wide + RIDGE * torch.eye(wide.shape[-1], dtype=wide.dtype, device=wide.device)
        return torch.linalg.solve(gram, wide.mT).float()

    @torch.no_grad()
    def fit(self, pairs: Pairs, which: Tensor) -> None:
        """Fit the maps in the mask ``which`` (m,) from scratch."""
        x = nn.functional.pad(pairs.control, (0, 1), value=1.0).double()
        use = pairs.filled.double()
        healthy = nn.functional.pad(self.space.nominal.double(), (0, 1))  # (4, k + 1)
        gram = (x * use[..., None]).mT @ x + self.ridge * torch.eye(x.shape[-1], dtype=x.dtype, device=x.device)
        away = (pairs.source.double() - x @ healthy.mT) * use[..., None]
        solution = healthy + torch.linalg.solve(gram, x.mT @ away).mT
        self.weight[which] = solution[which, :, :-1].float()
        self.bias[which] = solution[which, :, -1].float()
        left = (pairs.source.double() - x @ solution.mT) * use[..., None]
        freedom = (use.sum(-1) - x.shape[-1]).clamp_min(1)
        variance = left.square().sum(1).amax(-1) / freedom
        spread = torch.linalg.inv(gram).diagonal(dim1=-2, dim2=-1)[:, :-1].amax(-1)
        self.standard_error[which] = (variance * spread).sqrt()[which].float()

    def refine(self, pairs: Pairs, which: Tensor) -> None:
        """What is worth doing once after the last of several fits; nothing, because :meth:`fit` is exact."""

    @torch.no_grad()
    def gradient_step(self, pairs: Pairs, which: Tensor, rate: float) -> None:
        """One step down the gradient of Eq. 8 over the bag (Eq. 9), for the maps in ``which`` (m,).

        ``rate`` is relative to the largest step that cannot overshoot.
        """
        x = nn.functional.pad(pairs.control, (0, 1), value=1.0) * pairs.filled[..., None]
        effect = x[..., :-1] @ self.weight.mT + x[..., -1:] * self.bias[:, None]
        error = (effect - pairs.source) * pairs.filled[..., None]
        step = rate / x.square().sum((1, 2)).clamp_min(1e-9) * which
        gradient = error.mT @ x
        self.weight -= step[:, None, None] * gradient[..., :-1]
        self.bias -= step[:, None] * gradient[..., -1]
