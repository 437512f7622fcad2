"""Learning the map while flying: bag, threshold, gradient step, refit (Lu et al. 2023, section 4.1)."""

from collections.abc import Sequence
from typing import cast

import torch
from torch import Tensor, nn

from auv_torchrl.ddr.affine import AffineMap
from auv_torchrl.ddr.bag import Bag, Pairs, bag_size
from auv_torchrl.ddr.config import AdapterConfig
from auv_torchrl.quantities import counted


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
    def observe(
        self, state: Tensor, command: Tensor, source: Tensor, valid: Tensor, share: Tensor | None = None
    ) -> None:
        """Learn from one transition of N vehicles.

        Args:
            state: (N, s) x before.
            command: (N, k) commands tau_t that were executed.
            source: (N, a) R(x, x').
            valid: (N,) bool, transitions that happened.
            share: (N, n) what servos had made of the commands, shares of full thrust; None where there are none.
        """
        finite = state.isfinite().all(-1) & command.isfinite().all(-1)
        possible = finite & (source.abs() < self.config.impossible).all(-1)
        self.ignored += (valid & ~possible).sum()
        use = valid & possible & self.g.space.informative(command)
        share = self.g.space.delivered(command) if share is None else share
        pairs = Pairs(state[use], self.g.space.of_shares(share[use]), source[use])
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

    @property
    def learners(self) -> list["MapLearner"]:
        """This one."""
        return [self]

    @property
    def maps(self) -> tuple[AffineMap, ...]:
        """The one map."""
        return (self.g,)

    def invert(self, state: Tensor, tau: Tensor) -> Tensor:
        """H: controls (N, k) within limits for source channels (N, a) in states (N, s)."""
        return self.g.invert(state, tau)

    @torch.no_grad()
    def refit(self) -> None:
        """Fit the map from scratch to what is in the bag."""
        if self.bag.count >= self.config.least_pairs:
            self.g.fit(self.bag.pairs())
            self.g.refine(self.bag.pairs())
        self.residual.zero_()


class LearnerPerVehicle(nn.Module):
    """A map for each vehicle of a fleet, learnt from the flight of this vehicle alone.

    Args:
        learners: one for each vehicle, in the order of the rows.
    """

    def __init__(self, learners: Sequence[MapLearner]):
        super().__init__()
        self.each = nn.ModuleList(learners)

    @property
    def learners(self) -> list[MapLearner]:
        """One for each vehicle."""
        return cast(list[MapLearner], list(self.each))

    @property
    def maps(self) -> tuple[AffineMap, ...]:
        """G of each vehicle."""
        return tuple(learner.g for learner in self.learners)

    @property
    def uncertain(self) -> Tensor:
        """(N, 1) bool, which maps are to be refitted."""
        return torch.stack([learner.uncertain for learner in self.learners])[:, None]

    def observe(
        self, state: Tensor, command: Tensor, source: Tensor, valid: Tensor, share: Tensor | None = None
    ) -> None:
        """Learn from one transition of each of the N vehicles; arguments as of :class:`MapLearner`."""
        for row, learner in enumerate(self.learners):
            only = slice(row, row + 1)
            given = None if share is None else share[only]
            learner.observe(state[only], command[only], source[only], valid[only], given)

    def invert(self, state: Tensor, tau: Tensor) -> Tensor:
        """H of each vehicle: controls (N, k) within limits for source channels (N, a) in states (N, s).

        Raises:
            ValueError: if there are more or fewer rows than maps.
        """
        if len(tau) != len(self.each):
            raise ValueError(
                f"adapter.shared=false: there are maps for {counted(len(self.each), 'vehicle')}, and the fleet has "
                f"{len(tau)}: give DDRAdapter(..., count={len(tau)})"
            )
        rows = zip(self.maps, state.split(1), tau.split(1), strict=True)
        return torch.cat([g.invert(own, wanted) for g, own, wanted in rows])

    def refit(self) -> None:
        """Fit each map from scratch to what is in its bag."""
        for learner in self.learners:
            learner.refit()
