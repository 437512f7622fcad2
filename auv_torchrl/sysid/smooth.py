"""Smoothing: the motion that was measured, whatever the model has wrong.

Each window starts freely, and a force with a wide prior acts on it until the model follows the samples. What is left is
noise, and tells how large that is; single samples that no force could have reached are outliers.
"""

from dataclasses import dataclass, replace

import numpy as np

from auv_torchrl.sysid.linear import Linearised, best_free_numbers, linearise
from auv_torchrl.sysid.model import Floats
from auv_torchrl.sysid.path import Path, Problem
from auv_torchrl.sysid.windows import OUTLIER, Windows

ROUNDS = 12  # of Gauss-Newton at most; three are usual
SETTLED = 1e-3  # of chi-square, below which a round has changed nothing
FIRST_DAMPING, EASED, TIGHTENED = (
    1e-4,
    0.1,
    30.0,
)  # of the diagonal, after a round that helped, and after one that did not
LEAST_FREEDOM = 0.15  # share of the numbers of a channel that a free force must leave over to tell its noise
LEAST_SHARE = 0.05  # of a number, below which its residual says nothing
HUBER = 2.5  # standard deviations, from which the cost of a sample grows slower while its window is being followed
ROBUST_ROUNDS = 5  # of following and weighing at most
MANY_OUTLIERS = 0.2  # of a window: with more, the window was not followed, and none of its samples is blamed


@dataclass(frozen=True)
class Smoothing:
    """Samples that were smoothed: the problem with their noise and outliers, and the path that follows them."""

    problem: Problem
    linear: Linearised
    outliers: int  # samples that count less


def smooth(problem: Problem, values: Floats, known_noise: bool = False) -> Smoothing:
    """Follow the samples with a model of ``values`` (P,), measure their noise, and take trust from outliers.

    Noise that is known, from healthy flights or a data sheet, stays: noise that is fitted on a log hides what its model
    lacks.
    """
    given, linear = problem.windows.trust, follow(problem, values)
    for _ in range(ROBUST_ROUNDS):
        far = _size(problem, linear, given)
        trust = given * np.sqrt(
            HUBER / np.maximum(far, HUBER)
        )  # beyond, a cost grows with its size, not with its square
        if (trust == problem.windows.trust).all():
            break
        problem, linear = _again(problem, linear, problem.windows.with_noise(problem.windows.noise, trust))
    far = _size(problem, linear, given)
    outlying = (far > OUTLIER) & ((far > OUTLIER).mean((1, 2), keepdims=True) < MANY_OUTLIERS)
    trust = given * np.where(outlying, (OUTLIER / np.maximum(far, OUTLIER)) ** 2, 1.0)
    problem, linear = _again(problem, linear, problem.windows.with_noise(problem.windows.noise, trust))
    if not known_noise:
        white = np.minimum(problem.windows.noise.white, measured_noise(problem, linear))
        noise = replace(problem.windows.noise, white=white)
        problem, linear = _again(problem, linear, problem.windows.with_noise(noise))
    return Smoothing(problem, linear, int(outlying.sum()))


def _again(problem: Problem, linear: Linearised, windows: Windows) -> tuple[Problem, Linearised]:
    """The problem with other noise or trust, followed from the path that it had."""
    problem = replace(problem, windows=windows)
    return problem, follow(problem, linear.path.values, linear.path)


def _size(problem: Problem, linear: Linearised, given: Floats) -> Floats:
    """Residual (W, m, C) in standard deviations, whatever trust its samples have now; 0 where nothing was given."""
    trust = np.where(given > 0, problem.windows.trust, 1.0)
    return np.abs(linear.path.residual.reshape(given.shape)) / trust * given


def follow(problem: Problem, values: Floats, begin: Path | None = None) -> Linearised:
    """The path of a model of ``values`` (P,) that follows the samples under a wide force.

    Without a path to begin from, windows are followed in short pieces first, in which even a wrong model stays near.
    """
    precision = problem.precision(problem.model.force_width)
    start, bins = (problem.guess, problem.calm()) if begin is None else (begin.start, begin.bins)
    linear = linearise(problem, problem.simulate(values, start, bins))
    damping = np.full(len(problem.windows), FIRST_DAMPING)
    nothing = np.zeros_like(linear.path.residual)
    for _ in range(ROUNDS):
        trial = problem.simulate(values, *best_free_numbers(problem, linear, nothing, precision, damping))
        before, after = linear.path.chi2(problem, precision), trial.chi2(problem, precision)
        better = after < before
        damping = np.where(better, damping * EASED, damping * TIGHTENED)
        linear = linearise(problem, _chosen(better, trial, linear.path))
        gained = np.where(better & np.isfinite(before), before - after, 0.0)
        if (gained <= SETTLED * np.where(np.isfinite(before), before, 1.0)).all() and np.isfinite(before).all():
            break
    return linear


def measured_noise(problem: Problem, linear: Linearised) -> Floats:
    """White noise (C,) of each channel, from what a free force leaves of its samples.

    A channel of which the force follows nearly every sample keeps the noise that it has.
    """
    windows = problem.windows
    gram = linear.slope.swapaxes(1, 2) @ linear.slope + problem.precision(problem.model.force_width)
    followed = np.einsum("wkl,wlk->wk", linear.slope, np.linalg.solve(gram, linear.slope.swapaxes(1, 2)))
    free = np.clip(1.0 - followed, LEAST_SHARE, 1.0).reshape(windows.trust.shape)
    left = linear.path.residual.reshape(free.shape)
    counts = windows.trust**2
    white = windows.noise.white.copy()
    for column in range(len(white)):
        freedom = (free[..., column] * counts[..., column]).sum(1)
        if freedom.sum() > LEAST_FREEDOM * counts[..., column].sum():
            seen = freedom > 0
            squares = (left[seen][..., column] ** 2).sum(1) / freedom[seen]
            white[column] *= np.sqrt(np.median(squares))  # the median: a few windows may be badly followed
    return white


def _chosen(better: np.ndarray, new: Path, old: Path) -> Path:
    """By window, the new path where it is better."""
    fields = {
        name: np.where(
            better.reshape(-1, *(1,) * (getattr(new, name).ndim - 1)), getattr(new, name), getattr(old, name)
        )
        for name in ("start", "bins", "states", "residual")
    }
    return replace(old, **fields)
