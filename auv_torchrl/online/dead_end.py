"""Notice that a map leads nowhere: a vehicle that pushes with all its might, and stands still or goes in circles."""

import math
from typing import Any, ClassVar

import numpy as np

Array = Any
_AT_LIMIT = 0.98  # share of a thruster's limit
_MOST = 0.5  # of the thrusters; a single weak one may well be at its limit in holding a place
_STILL = 0.15  # m/s; thrusters at their limits give three times that, unless they push against each other
_STALLED_S = 1.5  # s; a healthy vehicle reaches full speed in less
_CIRCLE = 2 * math.pi  # rad; a vehicle that is brought to a heading never turns by more than half of that


class DeadEnd:
    """Standstill and circling of N vehicles with half of their thrusters or more at the limit.

    A wrong map can explain both: thrusters that push against each other, or that keep up a spin, do always the same,
    and from that nothing new is learnt.

    Args:
        count: number of vehicles N.
        limits: smallest and largest thrust (n,) of each thruster, shares of full thrust.
        control_dt: s.
    """

    FIELDS: ClassVar = ("stalled_s", "turned")

    def __init__(self, count: int, limits: tuple[Array, Array], control_dt: float):
        self.limits, self.control_dt = limits, control_dt
        self.stalled_s = np.zeros(count)
        self.turned = np.zeros(count)  # rad

    def begin(self, rows: Array) -> None:
        """Some vehicles have a new map, or are somewhere else."""
        self.stalled_s[rows] = self.turned[rows] = 0.0

    def reached(self, share: Array, velocity: Array) -> Array:
        """Which vehicles are in one, (N,) bool, after a step with thrusts (N, n) that ended at velocities (N, 4).

        A velocity that is no number is not known to be 0.
        """
        low, high = self.limits
        pushing = ((share > _AT_LIMIT * high) | (share < _AT_LIMIT * low)).mean(-1) >= _MOST
        with np.errstate(invalid="ignore"):
            still = np.linalg.norm(velocity[:, :3], axis=-1) < _STILL
        self.stalled_s = np.where(pushing & still, self.stalled_s + self.control_dt, 0.0)
        turn = self.control_dt * np.nan_to_num(velocity[:, 3])
        self.turned = np.where(pushing, self.turned + turn, 0.0)
        return (self.stalled_s > _STALLED_S) | (np.abs(self.turned) > _CIRCLE)
