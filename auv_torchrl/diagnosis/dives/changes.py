"""What changed over many dives: alarms as they would have been raised, and the changes seen from the end."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from auv_torchrl.diagnosis.dives.series import Series, alike, scattered, series_of
from auv_torchrl.diagnosis.dives.shifts import Shift, candidates, gains, shifts, threshold
from auv_torchrl.diagnosis.dives.told import Dive, Normal

MOST_CHANGED = 8  # numbers: more is another vehicle, and to be diagnosed dive by dive
RIVAL = 6.0  # of the gain, by which another number may do worse and still stand for the same change: 20 to 1


@dataclass(frozen=True)
class Alarm:
    """A change that was noticed as soon as a dive showed it, from that dive and those before alone."""

    dive: int  # from 0
    number: int
    rivals: tuple[int, ...]  # numbers that this may be as well
    gain: float


@dataclass(frozen=True)
class Change:
    """What happened to one number, seen from the last dive."""

    number: int
    shifts: tuple[Shift, ...]  # in the order of their moments
    rivals: tuple[int, ...]

    def at(self, dives: np.ndarray) -> np.ndarray:
        """Its deviation in some dives, by number from 0, from what it was before."""
        return sum((shift.at(dives) for shift in self.shifts), np.zeros(len(dives)))

    @property
    def probability(self) -> float:
        """That it changed at all."""
        return max(shift.probability for shift in self.shifts)


@dataclass(frozen=True)
class Judged:
    """All of it."""

    series: Series  # with what changed left free
    alarms: tuple[Alarm, ...]
    changes: tuple[Change, ...]
    threshold: float
    reference: int


def judge(dives: Sequence[Dive], normal: Normal, reference: int, dives_per_false_alarm: float) -> Judged:
    """Watch the dives one after the other, then look back over all of them.

    Args:
        dives: in the order in which they were flown, the reference first.
        normal: what the reference dives show.
        reference: how many of the dives are known to be sound.
        dives_per_false_alarm: dives of a sound vehicle that pass on average before one is called changed.
    """
    numbers = normal.all_numbers(dives)
    watched = np.array([number.watched for number in numbers])
    told = series_of(dives, normal, _of_the_day(normal)).told.any(1)
    limit = threshold(int((watched & told).sum()), reference, dives_per_false_alarm)
    look = partial(_noticed, dives, normal, reference, limit, watched)
    alarms, _ = look(range(reference + 1, len(dives) + 1), len(numbers))
    changed, free = look([len(dives)], MOST_CHANGED)
    series = scattered(series_of(dives, normal, free))
    odds = 1.0 / (dives_per_false_alarm * max(int(watched.sum()), 1))
    changes = []
    for alarm in changed:
        row = alarm.number
        found = shifts(series.value[row], series.variance[row], reference, limit, numbers[row].width, odds)
        if found:
            changes.append(Change(row, tuple(sorted(found, key=lambda shift: shift.begin)), alarm.rivals))
    return Judged(series, tuple(alarms), tuple(changes), limit, reference)


def _of_the_day(normal: Normal) -> np.ndarray:
    """(k,) what is never the vehicle's, and may be anything in every dive."""
    return np.array([number.is_daily for number in normal.numbers])


def _noticed(
    dives: Sequence[Dive],
    normal: Normal,
    reference: int,
    limit: float,
    watched: np.ndarray,
    looks: Sequence[int],
    most: int,
) -> tuple[list[Alarm], np.ndarray]:
    """The first ``most`` changes that stand out, and what is free then (k,).

    At each of the ``looks`` only the first so many dives are known.
    """
    free, quiet, found = _of_the_day(normal), watched.copy(), []
    series = series_of(dives, normal, free)
    for n in looks:
        while len(found) < most and (best := _best(series.first(n), reference, quiet))[1] > limit:
            row, gain, rivals = _named(best[0], dives[:n], normal, free)
            found.append(Alarm(n - 1, row, rivals, gain))
            quiet[row] = False
            if row < len(free):
                free[row] = True
                series = series_of(dives, normal, free)
    return found, free


def _best(series: Series, reference: int, quiet: np.ndarray) -> tuple[np.ndarray, float]:
    """Largest gain (K,) of each number that has raised no alarm yet, and the largest of these."""
    series = scattered(series)
    if not len(candidates(series.value.shape[1], reference).begin):
        return np.zeros(len(quiet)), 0.0
    each = np.where(quiet, gains(series.value, series.variance, reference).max(1), 0.0)
    return each, float(each.max())


def _named(
    each: np.ndarray, dives: Sequence[Dive], normal: Normal, free: np.ndarray
) -> tuple[int, float, tuple[int, ...]]:
    """The number that gains most, its gain, and those that may be meant as well."""
    row = int(each.argmax())
    rivals = each > each[row] - RIVAL
    k = len(normal.numbers)
    if row < k:
        rivals[:k] |= alike(dives, normal, free)[row] & (each[:k] > 0)
    rivals[row] = False
    return row, float(each[row]), tuple(np.flatnonzero(rivals).tolist())
