"""A hypothesis fitted by full simulation, and what it is worth."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from auv_torchrl.sysid.linear import (
    Linearised,
    Quadratic,
    best_free_numbers,
    linearise,
    reduced_quadratic,
    sensitivities,
)
from auv_torchrl.sysid.model import Floats
from auv_torchrl.sysid.path import Path, Problem
from auv_torchrl.sysid.prior import Prior

ROUNDS = 12  # of Gauss-Newton at most; four are usual
SETTLED = 0.1  # of chi-square, below which a round has changed nothing that evidence would show
SHORTENINGS = 5  # halvings of a step that does not help before the fit stays where it is
ROUNDING = 1e-14  # of the largest curvature: below, a sum of squares holds nothing but rounding
PROBE = 0.02  # of a standard deviation of the prior, by which a parameter is moved to see what it does


@dataclass(frozen=True)
class Fit:
    """A hypothesis with its values fitted."""

    prior: Prior
    values: Floats  # (P,)
    chi2: float  # of samples, starts, disturbances and parameters
    curvature: Floats  # (k, k) half of its Hessian in the moving parameters, in their prior standard deviations
    linear: Linearised
    numbers: float  # measured numbers, less those that starts took
    volume: float  # log of how much more starts and disturbances could do than the samples leave open

    @property
    def names(self) -> tuple[str, ...]:
        """Candidates of the hypothesis."""
        return self.prior.hypothesis.names

    @cached_property
    def log_evidence(self) -> float:
        """Log of the probability of the samples under the hypothesis, up to what all hypotheses share.

        A light system is moved far by a disturbance: what follows the samples by that pays for it by the volume.
        """
        if not np.isfinite(self.chi2):
            return -np.inf
        return self.prior.log_evidence(self.chi2, self.curvature) - 0.5 * self.volume

    @property
    def misfit(self) -> float:
        """Reduced chi-square: 1 where noise and disturbance alone are left."""
        return self.chi2 / self.numbers

    @cached_property
    def covariance(self) -> Floats:
        """(P, P) of the values that the log leaves open, in their units; 0 for parameters that stand."""
        at, widths = self.prior.moving, self.prior.widths
        covariance = np.zeros((len(self.values),) * 2)
        covariance[np.ix_(at, at)] = np.linalg.inv(self.curvature) * np.outer(widths[at], widths[at])
        return covariance


def least_quadratic(curvature: Floats, pull: Floats, low: Floats, high: Floats) -> Floats:
    """Where (k,) ``x H x - 2 g x`` is least within bounds, of a positive ``H`` (k, k)."""
    if not len(pull):
        return np.zeros(0)
    from scipy.linalg import cholesky, solve_triangular  # here: most of scipy takes longer to import than numpy

    curvature = curvature + ROUNDING * np.diag(curvature).max() * np.eye(len(pull))
    factor = cholesky(curvature)
    free = np.linalg.solve(curvature, pull)
    if ((free >= low) & (free <= high)).all():
        return free
    from scipy.optimize import lsq_linear

    right = solve_triangular(factor.T, pull, lower=True)
    return lsq_linear(factor, right, (low, np.maximum(high, low + 1e-12)), method="bvls").x


def fit(problem: Problem, prior: Prior, values: Floats, begin: Path) -> Fit:
    """Values, starts and disturbances together by bounded Gauss-Newton, from ``values`` (P,) and the path ``begin``."""
    precision = problem.precision(problem.disturbance.size)
    at, widths = prior.moving, prior.widths[prior.moving]
    low, high = ((bound - prior.center[at]) / widths for bound in prior.bounds)
    path = problem.simulate(_within(prior, values), begin.start, begin.bins)
    cost = _cost(problem, prior, path, precision)
    linear, columns, quadratic = _weighed(problem, prior, path, precision)
    for _ in range(ROUNDS if np.isfinite(cost) else 0):
        away = prior.away(path.values)
        pull = quadratic.b - prior.precision @ away
        step = least_quadratic(quadratic.A + prior.precision, pull, low - away, high - away)
        trial = _shortened(problem, prior, linear, columns, step, cost, precision)
        if trial is None:
            break
        gained, (path, cost) = cost - trial[1], trial
        linear, columns, quadratic = _weighed(problem, prior, path, precision)
        if gained < SETTLED:
            break
    determined, volume = _free_numbers(problem, linear, precision)
    numbers = problem.windows.numbers - determined
    return Fit(prior, path.values, cost, quadratic.A + prior.precision, linear, numbers, volume)


def _weighed(problem: Problem, prior: Prior, path: Path, precision: Floats) -> tuple[Linearised, Floats, Quadratic]:
    """A path linearised, its sensitivities (W, K, k), and the reduced quadratic about it."""
    linear = linearise(problem, path)
    columns = parameter_columns(problem, prior, linear)
    return linear, columns, reduced_quadratic(problem, linear, columns, precision)


def parameter_columns(problem: Problem, prior: Prior, linear: Linearised) -> Floats:
    """Sensitivities (W, K, k) to the moving parameters, per standard deviation of their prior.

    A parameter is moved to the side on which its bound is farther.
    """
    at, here = prior.moving, linear.path.values
    low, high = prior.bounds
    size = PROBE * prior.widths[at] * np.where(high - here[at] >= here[at] - low, 1.0, -1.0)
    rows = np.tile(here, (len(at), 1))
    rows[np.arange(len(at)), at] += size
    if not len(at):
        return np.zeros((*linear.path.residual.shape, 0))
    return sensitivities(problem, linear, rows) * (prior.widths[at] / size)


def _shortened(
    problem: Problem, prior: Prior, linear: Linearised, columns: Floats, step: Floats, cost: float, precision: Floats
) -> tuple[Path, float] | None:
    """The path behind as much of a step as helps, and its cost; None where nothing does."""
    for halving in range(SHORTENINGS):
        part = step * 0.5**halving
        values = linear.path.values.copy()
        values[prior.moving] += part * prior.widths[prior.moving]
        start, bins = best_free_numbers(problem, linear, columns @ part, precision)
        path = problem.simulate(_within(prior, values), start, bins)
        after = _cost(problem, prior, path, precision)
        if after < cost:
            return path, after
    return None


def _cost(problem: Problem, prior: Prior, path: Path, precision: Floats) -> float:
    return float(path.chi2(problem, precision).sum()) + prior.cost(path.values)


def _free_numbers(problem: Problem, linear: Linearised, precision: Floats) -> tuple[float, float]:
    """How many numbers of the starts the samples tell, and the log of what they take from all free numbers' volume.

    Numbers that samples tell are fitted, and leave no chi-square.
    """
    gram = linear.slope.swapaxes(1, 2) @ linear.slope + precision
    gram = gram[np.isfinite(gram).all((1, 2))]
    left, place = np.linalg.inv(gram), np.arange(problem.states)
    determined = float((1.0 - left[:, place, place] * precision[place, place]).sum())
    return determined, float((np.linalg.slogdet(gram)[1] - np.linalg.slogdet(precision)[1]).sum())


def _within(prior: Prior, values: Floats) -> Floats:
    """Values (P,) whose moving parameters are within their bounds."""
    low, high = prior.bounds
    values = values.copy()
    values[prior.moving] = np.clip(values[prior.moving], low, high)
    return values
