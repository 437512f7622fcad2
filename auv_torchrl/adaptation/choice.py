"""Which thrusts do what the source vehicle would, by what is known of the vehicle; with a dither while it is little."""

from typing import Any

import numpy as np

from auv_torchrl.adaptation.config import AdaptationConfig
from auv_torchrl.adaptation.estimate import Estimate
from auv_torchrl.adaptation.memory import Memory
from auv_torchrl.ddr.allocation import Allocation
from auv_torchrl.ddr.dither import Dither

Array = Any


class ThrustChoice(Memory):
    """Chooses the thrusts of N vehicles.

    Args:
        estimate: what is known of them.
        limits: smallest and largest thrust (n,) of each thruster, shares of full thrust.
        edge: (n,) shares of full thrust below which a thruster gives nothing.
        config: settings.
    """

    carried: Array  # (N, D) wrench that the dead band has withheld so far
    sign: Array  # (N, n) of the dither

    def __init__(self, estimate: Estimate, limits: tuple[Array, Array], edge: Array, config: AdaptationConfig):
        super().__init__()
        self.config, self.limits = config, limits
        self.motion = estimate.motion
        self.allocation = Allocation(estimate.weight, *limits)
        per_share = self.motion.per_share
        self.carry_limit = (np.abs(per_share) * edge).max(-1)
        self.dither = Dither(config.seed)
        count = len(estimate.noise_scale)
        self.remember(carried=np.zeros((count, self.motion.size)), sign=np.ones((count, per_share.shape[1])))

    def __call__(self, estimate: Estimate, nominal: Array, searching: Array, search_s: Array) -> Array:
        """Thrusts (N, n), shares of full thrust, whose wrench is what ``nominal`` (N, n) gives the source vehicle.

        Args:
            estimate: what is known of the vehicles.
            nominal: thrusts of the source vehicle.
            searching: (N,) bool, which vehicles' thrusters are to be found out about.
            search_s: (N,) s since their searches began.
        """
        effectiveness, constant = estimate.map
        stands = np.where(self.motion.fins, estimate.turned, nominal)
        flow = self.motion.flow(estimate.velocity, stands)
        wanted = (flow * nominal) @ self.motion.per_share.T - constant + self.carried
        caution = estimate.caution()
        pushing = flow[:, None] * flow[:, :, None]
        share = self.allocation(wanted, flow[:, None] * effectiveness, pushing * caution, nominal)
        if self.config.dither > 0 and searching.any():
            unknown = estimate.uncertainty(caution) > self.config.settled_below
            self._turn_dither(estimate.timing.late_s(), search_s)
            share = np.clip(share + self.config.dither * unknown * searching[:, None] * self.sign, *self.limits)
        return share

    def _turn_dither(self, late_s: Array, search_s: Array) -> None:
        """New signs, held for longer where thrust follows late: it must arrive before it turns again."""
        hold = 1 + np.ceil(late_s / self.motion.control_dt - 1e-9)
        drawn = self.dither.signs(self.sign.shape).numpy().astype(float)
        turns = np.round(search_s / self.motion.control_dt) % hold == 0
        self.sign = np.where(turns[:, None], drawn, self.sign)

    def withheld(self, estimate: Estimate, wanted: Array, given: Array, following: Array) -> None:
        """Remember the wrench lost to the dead band between shares wanted and given (N, n), to give it later."""
        effectiveness, _ = estimate.map
        lost = (effectiveness @ (wanted - given)[..., None])[..., 0]
        carried = np.clip(self.config.withheld_kept * self.carried + lost, -self.carry_limit, self.carry_limit)
        self.carried = np.where(following[:, None], carried, 0.0)
