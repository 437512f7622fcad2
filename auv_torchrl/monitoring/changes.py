"""What changed over many dives: series of parameters, alarms as they would have been raised, and changes at the end."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.monitoring.dive_record import Baseline, Dive, TrackedParameter
from auv_torchrl.monitoring.shifts import Shift, candidates, gains, shifts, threshold

NOISE_SPREAD = 0.05  # of the logarithm of a channel's noise from dive to dive: what third differences scatter by
SAME_SENSITIVITY = 0.98  # correlation of what two parameters do, from which no dive tells them apart
LEAST_INFORMATION = 1e-12
# Dives of a healthy vehicle that scatter more than was learnt of few of them must not become alarms. Second differences
# tell the scatter whether or not something drifts.
SCATTER_DIVES = 8.0  # second differences that the learnt spread counts for
LARGEST = 3.0  # standard deviations at which a second difference is cut: a step makes two large ones
MOST_CHANGED = 8  # parameters: more is another vehicle, and to be diagnosed dive by dive
RIVAL = 6.0  # of the gain, by which another parameter may do worse and still stand for the same change: 20 to 1


@dataclass(frozen=True)
class ParameterSeries:
    """Deviations of K parameters from the reference in n dives."""

    parameters: tuple[TrackedParameter, ...]
    value: Floats  # (K, n)
    variance: Floats  # (K, n) what a healthy vehicle differs by included; infinite where a dive has no information

    @property
    def is_informed(self) -> np.ndarray:
        """(K, n) whether the dive has information about the parameter."""
        return np.isfinite(self.variance)

    def first(self, n: int) -> "ParameterSeries":
        """The series as it was after n dives."""
        return ParameterSeries(self.parameters, self.value[:, :n], self.variance[:, :n])


@dataclass(frozen=True)
class Alarm:
    """A change that was noticed as soon as a dive showed it, from that dive and those before alone."""

    dive: int  # from 0
    row: int  # of the parameter
    rivals: tuple[int, ...]  # rows of parameters that may have changed instead
    gain: float


@dataclass(frozen=True)
class Change:
    """What happened to one parameter, seen from the last dive."""

    row: int  # of the parameter
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
class ChangeRecord:
    """All alarms and changes of a series of dives."""

    series: ParameterSeries  # with what changed left free
    alarms: tuple[Alarm, ...]
    changes: tuple[Change, ...]
    threshold: float
    reference: int


def find_changes(
    dives: Sequence[Dive], baseline: Baseline, reference: int, dives_per_false_alarm: float
) -> ChangeRecord:
    """Watch the dives one after the other, then look back over all of them.

    Args:
        dives: in the order in which they were flown, the reference first.
        baseline: what the reference dives show.
        reference: how many of the dives are known to be healthy.
        dives_per_false_alarm: dives of a healthy vehicle that pass on average before one is called changed.
    """
    parameters = baseline.all_parameters(dives)
    watched = np.array([parameter.watched for parameter in parameters])
    informed = series_of(dives, baseline, _of_the_day(baseline)).is_informed.any(1)
    limit = threshold(int((watched & informed).sum()), reference, dives_per_false_alarm)
    search = partial(_alarms, dives, baseline, reference, limit, watched)
    alarms, _ = search(range(reference + 1, len(dives) + 1), len(parameters))
    changed, free = search([len(dives)], MOST_CHANGED)
    series = with_measured_scatter(series_of(dives, baseline, free))
    odds = 1.0 / (dives_per_false_alarm * max(int(watched.sum()), 1))
    changes = []
    for alarm in changed:
        row = alarm.row
        found = shifts(series.value[row], series.variance[row], reference, limit, parameters[row].width, odds)
        if found:
            changes.append(Change(row, tuple(sorted(found, key=lambda shift: shift.begin)), alarm.rivals))
    return ChangeRecord(series, tuple(alarms), tuple(changes), limit, reference)


def series_of(dives: Sequence[Dive], baseline: Baseline, free: np.ndarray) -> ParameterSeries:
    """The value of each parameter in each dive.

    Each is estimated with every other parameter held within what a healthy vehicle varies by, but for those that are
    ``free`` (k,), which may be anywhere within their widths.
    """
    k, parameters = len(baseline.parameters), baseline.all_parameters(dives)
    open_by = np.where(free, baseline.width, 0.0) ** 2
    covariance = baseline.covariance + np.diag(open_by)
    value, variance = np.zeros((len(parameters), len(dives))), np.full((len(parameters), len(dives)), np.inf)
    for t, dive in enumerate(dives):
        reduced = np.linalg.inv(np.eye(k) + dive.A @ covariance)
        information, pull = np.einsum("ij,ji->i", reduced, dive.A), reduced @ dive.h
        seen = information > LEAST_INFORMATION
        size = np.full(k, np.inf)
        size[seen] = np.maximum(1 / information[seen] - open_by[seen], 0.0)
        informed = size < baseline.width**2
        value[:k, t][informed] = pull[informed] / information[informed]
        variance[:k, t][informed] = size[informed]
    for row, parameter in enumerate(parameters[k:], start=k):
        then = baseline.noise[parameter.member]
        ratios = np.array([np.log(dive.noise.get(parameter.member, np.nan) / then) for dive in dives])
        known = np.isfinite(ratios)
        value[row, known], variance[row, known] = ratios[known], NOISE_SPREAD**2
    return ParameterSeries(parameters, value, variance)


def with_measured_scatter(series: ParameterSeries) -> ParameterSeries:
    """The series with variances as large as its second differences ask for, and never smaller."""
    variance = series.variance.copy()
    for row, (value, own) in enumerate(zip(series.value, series.variance, strict=True)):
        informed = np.isfinite(own)
        y, v = value[informed], own[informed]
        if len(y) < 3:
            continue
        bent = (y[2:] - 2 * y[1:-1] + y[:-2]) ** 2 / np.maximum(v[2:] + 4 * v[1:-1] + v[:-2], LEAST_INFORMATION)
        seen = np.minimum(bent, LARGEST**2).sum()
        factor = (SCATTER_DIVES + seen) / (SCATTER_DIVES + len(bent))
        variance[row] *= max(1.0, factor)
    return ParameterSeries(series.parameters, series.value, variance)


def indistinguishable(dives: Sequence[Dive], baseline: Baseline, free: np.ndarray) -> np.ndarray:
    """(k, k) bool: parameters that no dive tells apart, because they do the same."""
    k = len(baseline.parameters)
    covariance = baseline.covariance + np.diag(np.where(free, baseline.width, 0.0) ** 2)
    total = sum((np.linalg.inv(np.eye(k) + dive.A @ covariance) @ dive.A for dive in dives), np.zeros((k, k)))
    size = np.sqrt(np.maximum(np.diag(total), LEAST_INFORMATION))
    return np.abs(total / np.outer(size, size)) > SAME_SENSITIVITY


def _of_the_day(baseline: Baseline) -> np.ndarray:
    """(k,) parameters that are never the vehicle's, and may have any value in every dive."""
    return np.array([parameter.is_daily for parameter in baseline.parameters])


def _alarms(
    dives: Sequence[Dive],
    baseline: Baseline,
    reference: int,
    limit: float,
    watched: np.ndarray,
    lengths: Sequence[int],
    most: int,
) -> tuple[list[Alarm], np.ndarray]:
    """The first ``most`` changes that stand out, and the parameters that are free then (k,).

    For each of the ``lengths`` only the first so many dives are known.
    """
    free, quiet, found = _of_the_day(baseline), watched.copy(), []
    series = series_of(dives, baseline, free)
    for n in lengths:
        while len(found) < most and (best := _best_gains(series.first(n), reference, quiet))[1] > limit:
            row, gain, rivals = _largest_gain(best[0], dives[:n], baseline, free)
            found.append(Alarm(n - 1, row, rivals, gain))
            quiet[row] = False
            if row < len(free):
                free[row] = True
                series = series_of(dives, baseline, free)
    return found, free


def _best_gains(series: ParameterSeries, reference: int, quiet: np.ndarray) -> tuple[np.ndarray, float]:
    """Largest gain (K,) of each parameter that has raised no alarm yet, and the largest of these."""
    series = with_measured_scatter(series)
    if not len(candidates(series.value.shape[1], reference).begin):
        return np.zeros(len(quiet)), 0.0
    each = np.where(quiet, gains(series.value, series.variance, reference).max(1), 0.0)
    return each, float(each.max())


def _largest_gain(
    each: np.ndarray, dives: Sequence[Dive], baseline: Baseline, free: np.ndarray
) -> tuple[int, float, tuple[int, ...]]:
    """The row of the parameter that gains most, its gain, and the rows of those that may have changed instead."""
    row = int(each.argmax())
    rivals = each > each[row] - RIVAL
    k = len(baseline.parameters)
    if row < k:
        rivals[:k] |= indistinguishable(dives, baseline, free)[row] & (each[:k] > 0)
    rivals[row] = False
    return row, float(each[row]), tuple(np.flatnonzero(rivals).tolist())
