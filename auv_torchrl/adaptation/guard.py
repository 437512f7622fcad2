"""Which measurements can be used: lost, frozen and impossible ones cannot."""

from typing import Any, NamedTuple

import numpy as np

from auv_torchrl.adaptation.config import AdaptationConfig
from auv_torchrl.adaptation.memory import Memory

Array = Any


class Verdict(NamedTuple):
    """Per vehicle, (N,) bool."""

    usable: Array  # the measurement may be learnt from
    restart: Array  # the motion begins anew at this measurement: time or place has jumped


class MeasurementGuard(Memory):
    """Judges the measurements of N vehicles one after another.

    A measurement is lost where it is not finite; frozen where every bit equals the one before although the
    thrusters push; impossible where it lies further from the expected one than thrusters can bring it.

    Args:
        count: number of vehicles N.
        control_dt: s between two measurements.
        reach: (4,) change of a measured value in one step by the full wrench.
        slack: (4,) difference that noise and uncertainty explain.
        config: says how late and how far off a measurement may be.
    """

    previous: Array  # (N, 8) the last measurement
    time: Array  # (N,) s, of it
    impossible: Array  # (N,) number of impossible measurements in a row

    def __init__(self, count: int, control_dt: float, reach: Array, slack: Array, config: AdaptationConfig):
        super().__init__()
        self.control_dt, self.config = control_dt, config
        self.bound = config.largest_reach * reach + slack
        nothing = np.full((count, 8), np.nan)
        self.remember(previous=nothing, time=np.full(count, np.nan), impossible=np.zeros(count, dtype=np.int64))

    def begin(self, rows: Array) -> None:
        """A new episode of some vehicles: nothing came before."""
        self.time[rows] = np.nan
        self.previous[rows] = np.nan
        self.impossible[rows] = 0

    def judge(self, raw: Array, time: Array, difference: Array, pushing: Array) -> Verdict:
        """One measurement of each vehicle.

        Args:
            raw: (N, 8) everything measured, to be compared bit by bit with the one before.
            time: (N,) s.
            difference: (N, 4) measured less expected; NaN where the measurement is.
            pushing: (N,) bool, whether any thruster was commanded to push.
        """
        finite = np.isfinite(raw).all(-1) & np.isfinite(difference).all(-1) & np.isfinite(time)
        frozen = (raw == self.previous).all(-1) & pushing
        elapsed = time - self.time
        in_time = np.isnan(self.time) | (np.abs(elapsed - self.control_dt) < self.config.late_share * self.control_dt)
        with np.errstate(invalid="ignore"):
            possible = (np.abs(difference) < self.bound).all(-1)
        present = finite & ~frozen
        self.impossible = np.where(present & ~possible, self.impossible + 1, np.where(present, 0, self.impossible))
        moved = self.impossible >= self.config.believed_after
        self.impossible[moved] = 0
        restart = present & (~in_time | moved)
        self.previous = raw.copy()
        self.time = np.where(np.isfinite(time), time, self.time + self.control_dt)
        return Verdict(usable=present & in_time & possible, restart=restart)
