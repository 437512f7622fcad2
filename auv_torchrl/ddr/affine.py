"""G and H as affine maps: G(tau_t) = W tau_t + b, and H its inverse within the limits."""

import torch
from torch import Tensor, nn

from auv_torchrl.ddr.actuation import ControlSpace
from auv_torchrl.ddr.allocation import RIDGE
from auv_torchrl.ddr.bag import Pairs


class AffineMap(nn.Module):
    """One affine map for all vehicles.

    G is fitted to pairs (tau_t, R(x, x')) by Eq. 8 of Lu et al. 2023; the sum of squares has a closed-form
    minimiser. H minimises the cycle loss |H(G(tau_t)) - tau_t| for that G: where W is invertible this is
    tau -> W^-1 (tau - b) exactly, whatever the pairs, and no noise of R enters it a second time. H is never
    the map tau_t -> tau_s itself, which is right only for faults that are their own inverse.

    Args:
        space: the commands tau_t.
        ridge: pull towards the healthy map, in pairs of unit size.
    """

    weight: Tensor  # (a, k)
    bias: Tensor  # (a,)
    standard_error: Tensor  # () largest standard error of a weight; infinite before the first fit

    def __init__(self, space: ControlSpace, ridge: float):
        super().__init__()
        self.space = space
        self.ridge = ridge
        self.register_buffer("weight", space.nominal.clone())
        self.register_buffer("bias", torch.zeros(space.nominal.shape[0]))
        self.register_buffer("standard_error", torch.full((), torch.inf))

    @property
    def weights(self) -> int:
        """n_p, the number of unknown weights of G."""
        return self.weight.numel() + self.bias.numel()

    @property
    def condition(self) -> Tensor:
        """Ratio of the largest to the smallest singular value of W, ()."""
        size = torch.linalg.svdvals(self.weight)
        return size[0] / size[-1]

    def forward(self, state: Tensor, control: Tensor) -> Tensor:
        """G: what controls (n, k) do in states (n, s), in source channels (n, a)."""
        return control @ self.weight.mT + self.bias

    def invert(self, state: Tensor, tau: Tensor) -> Tensor:
        """H: controls (N, k) within limits whose G comes nearest to ``tau`` (N, a)."""
        return self.space.nearest(self.weight[None], tau - self.bias)

    @property
    def unlimited(self) -> Tensor:
        """H without limits and bias, (k, a)."""
        wide = self.weight.double()
        gram = wide.mT @ wide + RIDGE * torch.eye(wide.shape[-1], dtype=wide.dtype, device=wide.device)
        return torch.linalg.solve(gram, wide.mT).float()

    @torch.no_grad()
    def fit(self, pairs: Pairs) -> None:
        """Fit the map from scratch."""
        x = nn.functional.pad(pairs.control, (0, 1), value=1.0).double()
        healthy = nn.functional.pad(self.space.nominal.double(), (0, 1))  # (a, k + 1)
        gram = x.mT @ x + self.ridge * torch.eye(x.shape[-1], dtype=x.dtype, device=x.device)
        away = pairs.source.double() - x @ healthy.mT
        solution = healthy + torch.linalg.solve(gram, x.mT @ away).mT
        self.weight.copy_(solution[:, :-1])
        self.bias.copy_(solution[:, -1])
        left = pairs.source.double() - x @ solution.mT
        variance = left.square().sum(0).amax() / max(len(x) - x.shape[-1], 1)
        spread = torch.linalg.inv(gram).diagonal()[:-1].amax()
        self.standard_error.copy_((variance * spread).sqrt())

    def refine(self, pairs: Pairs) -> None:
        """What is worth doing once after the last of several fits; nothing, because :meth:`fit` is exact."""

    @torch.no_grad()
    def gradient_step(self, pairs: Pairs, rate: float) -> None:
        """One step down the gradient of Eq. 8 over the bag (Eq. 9).

        ``rate`` is relative to the largest step that cannot overshoot.
        """
        x = nn.functional.pad(pairs.control, (0, 1), value=1.0)
        step = rate / x.square().sum().clamp_min(1e-9)
        gradient = (self(pairs.state, pairs.control) - pairs.source).mT @ x
        self.weight -= step * gradient[:, :-1]
        self.bias -= step * gradient[:, -1]
