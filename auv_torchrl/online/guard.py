"""Which measurements can be used: lost, frozen and impossible ones cannot."""

from typing import Any, NamedTuple

import numpy as np

Array = Any
_LATE = 0.2  # of a control step: a measurement whose time is further off belongs to another step
_FASTEST = 4.0  # times what the full wrench changes in one step: a thruster cannot do more than reverse
_BELIEVED_AGAIN = 3  # impossible measurements in a row that agree with each other are a new truth


class Verdict(NamedTuple):
    """Per vehicle, (N,) bool."""

    usable: Array  # the measurement may be learnt from
    restart: Array  # the motion begins anew at this measurement: time or place has jumped


class MeasurementGuard:
    """Judges the measurements of N vehicles one after another.

    A measurement is lost where it is not finite; frozen where every bit equals the one before although the
    thrusters push; impossible where it lies further from the expected one than thrusters can bring it.

    Args:
        count: number of vehicles N.
        control_dt: s between two measurements.
        reach: (4,) change of a measured value in one step by the full wrench.
        slack: (4,) difference that noise and uncertainty explain.
    """

    FIELDS = ("previous", "time", "impossible")

    def __init__(self, count: int, control_dt: float, reach: Array, slack: Array):
        self.control_dt = control_dt
        self.bound = _FASTEST * reach + slack
        self.previous = np.full((count, 0), np.nan)
        self.time = np.full(count, np.nan)
        self.impossible = np.zeros(count, dtype=np.int64)

    def begin(self, rows: Array) -> None:
        """A new episode of some vehicles: nothing came before."""
        self.time[rows] = np.nan
        self.previous[rows] = np.nan
        self.impossible[rows] = 0

    def judge(self, raw: Array, time: Array, difference: Array, pushing: Array) -> Verdict:
        """One measurement of each vehicle.

        Args:
            raw: (N, k) everything measured, to be compared bit by bit with the one before.
            time: (N,) s.
            difference: (N, 4) measured less expected; NaN where the measurement is.
            pushing: (N,) bool, whether any thruster was commanded to push.
        """
        if self.previous.shape != raw.shape:
            self.previous = np.full(raw.shape, np.nan)
        finite = np.isfinite(raw).all(-1) & np.isfinite(difference).all(-1) & np.isfinite(time)
        frozen = (raw == self.previous).all(-1) & pushing
        elapsed = time - self.time
        in_time = np.isnan(self.time) | (np.abs(elapsed - self.control_dt) < _LATE * self.control_dt)
        with np.errstate(invalid="ignore"):
            possible = (np.abs(difference) < self.bound).all(-1)
        present = finite & ~frozen
        self.impossible = np.where(present & ~possible, self.impossible + 1, np.where(present, 0, self.impossible))
        moved = self.impossible >= _BELIEVED_AGAIN
        self.impossible[moved] = 0
        restart = present & (~in_time | moved)
        self.previous = raw.copy()
        self.time = np.where(np.isfinite(time), time, self.time + self.control_dt)
        return Verdict(usable=present & in_time & possible, restart=restart)
