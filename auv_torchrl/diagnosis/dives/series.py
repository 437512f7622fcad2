"""From what dives tell to one value per number and dive, as if it alone, and what is free, were other than normal."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auv_torchrl.diagnosis.dives.told import Dive, Normal, Number
from auv_torchrl.diagnosis.motion.windows import Floats

NOISE_SPREAD = 0.05  # of the logarithm of a channel's noise from dive to dive: what third differences scatter by
ALIKE = 0.98  # correlation of what two numbers do, from which no dive tells them apart
LEAST_INFORMATION = 1e-12
# Dives of a sound vehicle that scatter more than was learnt of few of them must not become alarms. Second differences
# tell the scatter whether or not something drifts.
SCATTER_DIVES = 8.0  # second differences that the learnt spread counts for
LARGEST = 3.0  # standard deviations at which a second difference is cut: a step makes two large ones


@dataclass(frozen=True)
class Series:
    """Deviations of K numbers from the reference in n dives."""

    numbers: tuple[Number, ...]
    value: Floats  # (K, n)
    variance: Floats  # (K, n) what a sound vehicle differs by included; infinite where a dive does not tell

    @property
    def told(self) -> np.ndarray:
        """(K, n) whether the dive tells the number."""
        return np.isfinite(self.variance)

    def first(self, n: int) -> "Series":
        """The series as it was after n dives."""
        return Series(self.numbers, self.value[:, :n], self.variance[:, :n])


def series_of(dives: Sequence[Dive], normal: Normal, free: np.ndarray) -> Series:
    """The value of each number in each dive.

    Each is estimated with every other number held within what a sound vehicle varies by, but for those that are
    ``free`` (k,), which may be anywhere within their widths.
    """
    k, numbers = len(normal.numbers), normal.all_numbers(dives)
    open_by = np.where(free, normal.width, 0.0) ** 2
    covariance = normal.covariance + np.diag(open_by)
    value, variance = np.zeros((len(numbers), len(dives))), np.full((len(numbers), len(dives)), np.inf)
    for t, dive in enumerate(dives):
        reduced = np.linalg.inv(np.eye(k) + dive.A @ covariance)
        information, pull = np.einsum("ij,ji->i", reduced, dive.A), reduced @ dive.h
        seen = information > LEAST_INFORMATION
        size = np.full(k, np.inf)
        size[seen] = np.maximum(1 / information[seen] - open_by[seen], 0.0)
        told = size < normal.width**2
        value[:k, t][told] = pull[told] / information[told]
        variance[:k, t][told] = size[told]
    for row, number in enumerate(numbers[k:], start=k):
        then = normal.noise[number.member]
        ratios = np.array([np.log(dive.noise.get(number.member, np.nan) / then) for dive in dives])
        known = np.isfinite(ratios)
        value[row, known], variance[row, known] = ratios[known], NOISE_SPREAD**2
    return Series(numbers, value, variance)


def scattered(series: Series) -> Series:
    """The series with variances as large as its second differences ask for, and never smaller."""
    variance = series.variance.copy()
    for row, (value, own) in enumerate(zip(series.value, series.variance, strict=True)):
        told = np.isfinite(own)
        y, v = value[told], own[told]
        if len(y) < 3:
            continue
        bent = (y[2:] - 2 * y[1:-1] + y[:-2]) ** 2 / np.maximum(v[2:] + 4 * v[1:-1] + v[:-2], LEAST_INFORMATION)
        seen = np.minimum(bent, LARGEST**2).sum()
        factor = (SCATTER_DIVES + seen) / (SCATTER_DIVES + len(bent))
        variance[row] *= max(1.0, factor)
    return Series(series.numbers, series.value, variance)


def alike(dives: Sequence[Dive], normal: Normal, free: np.ndarray) -> np.ndarray:
    """(k, k) bool: numbers that no dive tells apart, because they do the same."""
    k = len(normal.numbers)
    covariance = normal.covariance + np.diag(np.where(free, normal.width, 0.0) ** 2)
    total = sum((np.linalg.inv(np.eye(k) + dive.A @ covariance) @ dive.A for dive in dives), np.zeros((k, k)))
    size = np.sqrt(np.maximum(np.diag(total), LEAST_INFORMATION))
    return np.abs(total / np.outer(size, size)) > ALIKE
