"""Learning the map while flying: bag, threshold, gradient step, refit (Lu et al. 2023, section 4.1)."""

import torch
from torch import Tensor, nn

from auv_torchrl.ddr.affine import AffineMap
from auv_torchrl.ddr.bag import Bag, Pairs, bag_size
from auv_torchrl.ddr.config import AdapterConfig


class MapLearner(nn.Module):
    """Keeps m maps up to date with the transitions of the target.

    A map is either uncertain (``uncertain`` is set: pairs are collected with a dither, and the map is refitted from
    scratch with each new pair as soon as there are enough) or settled (small errors are followed by gradient
    steps). The mean of Eq. 8 over the last ``window`` informative pairs beyond ``threshold`` empties the bag and
    makes the map uncertain again; a standard error of its weights below ``tolerance`` settles it.

    Args:
        g: the maps.
        states: length of x.
        config: settings.
    """

    uncertain: Tensor  # (m,) bool
    residual: Tensor  # (m, window) newest values of Eq. 8, newest last
    ignored: Tensor  # () pairs left out because a measurement was not finite or jumped impossibly

    def __init__(self, g: AffineMap, states: int, config: AdapterConfig):
        super().__init__()
        self.g = g
        self.config = config
        maps, channels, controls = g.weight.shape
        size = max(bag_size(g.weights_per_map, config.bag_cap), config.bag_least, config.least_pairs)
        self.bag = Bag(maps, size, states, controls, channels)
        self.register_buffer("uncertain", torch.ones(maps, dtype=torch.bool))
        self.register_buffer("residual", torch.zeros(maps, config.window))
        self.register_buffer("ignored", torch.zeros((), dtype=torch.long))

    @torch.no_grad()
    def observe(self, state: Tensor, command: Tensor, source: Tensor, valid: Tensor) -> None:
        """Learn from one transition of N vehicles.

        Args:
            state: (N, s) x before.
            command: (N, k) commands tau_t that were executed.
            source: (N, 4) R(x, x').
            valid: (N,) bool, transitions that happened.
        """
        finite = state.isfinite().all(-1) & command.isfinite().all(-1)
        possible = finite & (source.abs() < self.config.impossible).all(-1)
        self.ignored += (valid & ~possible).sum()
        use = valid & possible & self.g.space.informative(command)
        maps = self.uncertain.shape[0]
        control = self.g.space.encode(command)

        def of_each_map(field: Tensor) -> Tensor:
            return torch.where(use[..., None], field, 0.0).reshape(maps, -1, field.shape[-1])

        pairs = Pairs(of_each_map(state), of_each_map(control), of_each_map(source), use.reshape(maps, -1))
        self._watch(pairs)
        self.bag.push(pairs)
        self._update(pairs.filled.any(-1))

    def _watch(self, pairs: Pairs) -> None:
        """Empty the bags of maps that no longer explain what is seen."""
        error = (self.g(pairs.state, pairs.control) - pairs.source).norm(dim=-1)
        number = pairs.filled.sum(-1)
        seen = number > 0
        mean = torch.where(pairs.filled, error, 0.0).sum(-1) / number.clamp_min(1)
        rolled = torch.cat((self.residual[:, 1:], mean[:, None]), dim=-1)
        self.residual.copy_(torch.where(seen[:, None], rolled, self.residual))
        alarm = (self.residual.mean(-1) > self.config.threshold) & ~self.uncertain
        self.bag.empty(alarm)
        self.residual.masked_fill_(alarm[:, None], 0.0)
        self.uncertain |= alarm

    def _update(self, new: Tensor) -> None:
        """Refit uncertain maps, step settled ones."""
        enough = self.bag.count >= self.config.least_pairs
        refit = self.uncertain & enough & new
        settled = ~self.uncertain & new
        if bool(refit.any()):
            self.g.fit(self.bag.pairs(), refit)
            certain = refit & (self.g.standard_error < self.config.tolerance)
            self.g.refine(self.bag.pairs(), certain)
            self.uncertain &= ~certain
        if self.config.gradient_rate > 0 and bool(settled.any()):
            self.g.gradient_step(self.bag.pairs(), settled, self.config.gradient_rate)

    @torch.no_grad()
    def refit(self) -> None:
        """Fit all maps from scratch to what is in their bags."""
        enough = self.bag.count >= self.config.least_pairs
        self.g.fit(self.bag.pairs(), enough)
        self.g.refine(self.bag.pairs(), enough)
        self.residual.zero_()
