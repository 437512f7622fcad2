"""Samples that lie off the path of their column, and moments at which the path itself jumps.

A vehicle does not leap from one sample to the next. What it does change by is judged by the column itself: its noise,
what it usually changes by, and what it changes by just before and behind.
"""

import numpy as np

from auv_torchrl.flightlog.log import ANGLES, POSE, Floats
from auv_torchrl.flightlog.signals import rolling_median

NEAR = 4  # changes before and behind, whose median is the motion
AROUND = 2  # samples before and behind, whose median is the path
LEAPS = 8.0  # robust standard deviations of what changes differ by from those around them, and
USUAL = 3.0  # times what 95 % of them, and of the changes themselves, stay below: a leap
TOO_MANY = 0.05  # share of leaps from which they are how the vehicle moves
TUMBLE = 1.0  # rad: a larger leap of an angle may be a vehicle that tumbles through the pole of its Euler angles


def find_leaps(name: str, t: Floats, v: Floats, stretch: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions of samples that lie off the path, and of the first sample behind each jump of the path itself.

    Args:
        name: of the axis.
        t: (T,) s.
        v: (T,) values, m or rad.
        stretch: (T,) number of the uninterrupted stretch that each belongs to.
        step: in which the values are written; 0 where it is finer than can be told.
    """
    none = np.empty(0, int)
    if len(v) < 4 * NEAR or name not in POSE:  # a velocity may leap: vehicles hit things
        return none, none
    series = np.unwrap(v) if name in ANGLES else v
    far = np.abs(series - rolling_median(series, 2 * AROUND + 1))
    change, off = _changes(t, series, stretch)
    odd, moved = (float(np.quantile(np.abs(size), 0.95)) for size in (off, change))
    noise = max(LEAPS * 1.4826 * float(np.median(np.abs(off))), USUAL * odd, LEAPS * step)
    least = max(noise, USUAL * moved)
    around = rolling_median(np.abs(np.concatenate([change[:1], change])), 2 * NEAR + 1)
    outlier = far > np.maximum(noise, USUAL * around)
    # The median at the first value is that value; a vehicle that is fast already goes on so.
    outlier[:1] |= min(abs(change[0]), abs(change[0] - change[1])) > least
    if name in ANGLES:
        outlier &= far < TUMBLE
    edge = np.flatnonzero(np.diff(stretch))
    for k in range(AROUND):  # beside the edge of a stretch, the median is of another one
        outlier[edge - k] = outlier[np.minimum(edge + 1 + k, len(v) - 1)] = False
    if outlier.mean() > TOO_MANY:
        return none, none
    kept = np.flatnonzero(~outlier)
    change, off = _changes(t[kept], series[kept], stretch[kept])
    hits = np.flatnonzero(np.abs(off) > least)
    alone = np.diff(np.concatenate([[-np.inf], hits, [np.inf]])) > NEAR
    jumps = [hit for hit, before, behind in zip(hits, alone[:-1], alone[1:], strict=True) if before and behind]
    if len(hits) > TOO_MANY * len(off):
        jumps = []
    possible = [hit for hit in jumps if not (name in ANGLES and abs(off[hit]) > TUMBLE) and _stays(off, hit)]
    return np.flatnonzero(outlier), kept[np.array(possible, int) + 1]


def _changes(t: Floats, series: Floats, stretch: np.ndarray) -> tuple[Floats, Floats]:
    """Changes from sample to sample (0 from one stretch to the next), and what they differ by from those around."""
    pause = np.maximum(np.diff(t), 1e-9)
    together = np.diff(stretch) == 0
    change = np.where(together, np.diff(series) * np.minimum(1.0, np.median(pause) / pause), 0.0)
    return change, np.where(together, change - rolling_median(change, 2 * NEAR + 1), 0.0)


def _stays(off: Floats, hit: int | np.integer) -> bool:
    """Whether the samples around a leap keep the distance that it made."""
    around = np.concatenate([off[max(0, hit - NEAR) : hit], off[hit + 1 : hit + 1 + NEAR]])
    return len(around) >= NEAR and bool(abs(around.sum()) < 0.5 * abs(off[hit]))
