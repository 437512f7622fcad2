"""Learning the map while flying: bag, threshold, gradient step, refit (Lu et al. 2023, section 4.1)."""

import torch
from torch import Tensor, nn

from auv_torchrl.ddr.affine import AffineMap
from auv_torchrl.ddr.bag import Bag, Pairs, bag_size
from auv_torchrl.ddr.config import AdapterConfig


class MapLearner(nn.Module):
    """Keeps the map up to date with the transitions of the target.

    It is either uncertain (``uncertain`` is set: pairs are collected with a dither, and the map is refitted from
    scratch with new pairs as soon as there are enough) or settled (small errors are followed by gradient
    steps). The mean of Eq. 8 over the last ``window`` informative pairs beyond ``threshold`` empties the bag and
    makes the map uncertain again; a standard error of its weights below ``tolerance`` settles it.

    Args:
        g: the map.
        states: length of x.
        config: settings.
    """

    uncertain: Tensor  # () bool
    residual: Tensor  # (window,) newest values of Eq. 8, newest last
    ignored: Tensor  # () pairs left out because a measurement was not finite or jumped impossibly

    def __init__(self, g: AffineMap, states: int, config: AdapterConfig):
        super().__init__()
        self.g = g
        self.config = config
        channels, controls = g.weight.shape
        size = max(bag_size(g.weights, config.bag_cap), config.bag_least, config.least_pairs)
        self.bag = Bag(size, states, controls, channels)
        self.register_buffer("uncertain", torch.ones((), dtype=torch.bool))
        self.register_buffer("residual", torch.zeros(config.window))
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
        pairs = Pairs(state[use], self.g.space.encode(command[use]), source[use])
        if len(pairs.state):
            error = (self.g(pairs.state, pairs.control) - pairs.source).norm(dim=-1).mean()
            self.residual.copy_(torch.cat((self.residual[1:], error[None])))
        if not self.uncertain and self.residual.mean() > self.config.threshold:  # it no longer explains what is seen
            self.bag.empty()
            self.residual.zero_()
            self.uncertain.fill_(True)
        self.bag.push(pairs)
        if len(pairs.state):
            self._update()

    def _update(self) -> None:
        """Refit an uncertain map, step a settled one."""
        if not self.uncertain:
            if self.config.gradient_rate > 0:
                self.g.gradient_step(self.bag.pairs(), self.config.gradient_rate)
        elif self.bag.count >= self.config.least_pairs:
            self.g.fit(self.bag.pairs())
            if self.g.standard_error < self.config.tolerance:
                self.g.refine(self.bag.pairs())
                self.uncertain.fill_(False)

    @torch.no_grad()
    def refit(self) -> None:
        """Fit the map from scratch to what is in the bag."""
        if self.bag.count >= self.config.least_pairs:
            self.g.fit(self.bag.pairs())
            self.g.refine(self.bag.pairs())
        self.residual.zero_()
