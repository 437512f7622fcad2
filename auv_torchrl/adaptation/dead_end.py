"""Notice that a map leads nowhere: a vehicle that pushes with all its might, and stands still or goes in circles."""

import math
from typing import Any

import numpy as np

from auv_torchrl.adaptation.config import AdaptationConfig
from auv_torchrl.adaptation.memory import Memory

Array = Any


class DeadEnd(Memory):
    """Standstill and circling of N vehicles with many of their thrusters at the limit.

    A wrong map can explain both: thrusters that push against each other, or that keep up a spin, do always the same,
    and from that nothing new is learnt.

    Args:
        count: number of vehicles N.
        limits: smallest and largest thrust (n,) of each thruster, shares of full thrust.
        control_dt: s.
        config: says how many thrusters, how still, how long, how far round.
    """

    stalled_s: Array  # (N,)
    turned: Array  # (N,) rad

    def __init__(self, count: int, limits: tuple[Array, Array], control_dt: float, config: AdaptationConfig):
        super().__init__()
        self.limits, self.control_dt, self.config = limits, control_dt, config
        self.remember(stalled_s=np.zeros(count), turned=np.zeros(count))

    def begin(self, rows: Array) -> None:
        """Some vehicles have a new map, or are somewhere else."""
        self.stalled_s[rows] = self.turned[rows] = 0.0

    def reached(self, share: Array, velocity: Array) -> Array:
        """Which vehicles are in one, (N,) bool, after a step with thrusts (N, n) that ended at velocities (N, 4).

        A velocity that is no number is not known to be 0.
        """
        config, (low, high) = self.config, self.limits
        at_limit = (share > config.at_limit * high) | (share < config.at_limit * low)
        pushing = at_limit.mean(-1) >= config.pushing_share
        with np.errstate(invalid="ignore"):
            still = np.linalg.norm(velocity[:, :3], axis=-1) < config.still_speed
        self.stalled_s = np.where(pushing & still, self.stalled_s + self.control_dt, 0.0)
        turn = self.control_dt * np.nan_to_num(velocity[:, 3])
        self.turned = np.where(pushing, self.turned + turn, 0.0)
        return (self.stalled_s > config.stalled_s) | (np.abs(self.turned) > 2 * math.pi * config.circles)
