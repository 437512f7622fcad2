"""Values and their covariance, beside nuisance parameters, and beside scales of the vehicle that no log tells."""

from collections.abc import Iterator
from dataclasses import dataclass
from operator import attrgetter

import numpy as np

from auv_torchrl.diagnosis.identify.assess import (
    joint_precision,
    parted_from_nuisance,
    shared_with_nuisance,
    take_step,
    value_steps,
)
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.hypotheses import declared
from auv_torchrl.diagnosis.identify.paths import Fit, nuisance_now
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import NUISANCE_SHARES, TELLS_SCALES

LIKELIHOOD = attrgetter("likelihood")


@dataclass(frozen=True)
class Minimum:
    """Of a quadratic under a prior."""

    likelihood: float  # natural logarithm, all numbers integrated out
    step: Floats  # (n,) to it
    curvature: Floats  # (n, n) there


def as_sure(problem: Problem, fit: Fit) -> tuple[Explanation, Floats]:
    """The explanation and the covariance (m, m) of its values, nuisance parameters as wide as this log shows.

    The width of nuisance parameters is the likeliest share of their prior width (type II maximum likelihood): a log of
    a vehicle that is as its file says shows a small share, and tells the values of an effect better. What healthy
    flights leave open was measured and keeps its whole width, also where the fit held it. Values move by what the other
    width does to them.

    All fits hold a scale of the vehicle that no healthy flight tells. Where this log tells the scale after all, as the
    direction of a tether does, the values go with it. Else the values are as uncertain as the scale makes them
    (Schmidt 1966, consider covariance).
    """
    explanation, known = parted_from_nuisance(problem, fit.explanation), problem.known
    k, n = len(problem.nuisance), len(fit.quadratic.b)
    scales = np.empty((k, 0)) if known is None or known.scales is None else known.scales
    numbers = np.concatenate([_as_one_number(problem, fit), np.pad(scales, ((0, n - k), (0, 0)))], axis=1)
    A, b = numbers.T @ fit.quadratic.A @ numbers, numbers.T @ fit.quadratic.b
    width, measured = (known.nuisance_covariance, known.shrinks) if known else (problem.nuisance_covariance, None)
    given = problem, explanation, fit.steps
    at_fit = next(_by_share(*given, A[:n, :n], b[:n], problem.nuisance_covariance)).step
    left = np.linalg.inv(max(_by_share(*given, A, b, width, measured), key=LIKELIHOOD).curvature)[n:, n:]
    size, directions = np.linalg.eigh(left)
    turn = np.eye(len(b))
    turn[n:, n:] = directions  # what the log tells of the scales first
    A, b, scales = turn.T @ A @ turn, turn.T @ b, scales @ directions
    free = n + int((size < TELLS_SCALES**2).sum())
    best = max(_by_share(*given, A[:free, :free], b[:free], width, measured), key=LIKELIHOOD)
    step, held = np.pad(best.step, (0, len(b) - free)), np.eye(len(b) - free)
    carried = np.concatenate([-np.linalg.solve(best.curvature, A[:free, free:]), held])
    covariance = np.pad(np.linalg.inv(best.curvature), (0, len(held))) + carried @ carried.T
    of_scales, by = _of_a_share(problem, explanation) @ scales, step[:n] - at_fit
    moved = take_step(problem, explanation, by[k:] * fit.steps + of_scales @ step[n:], by[:k])
    to_values = np.concatenate([np.diag(fit.steps), of_scales], axis=1)
    return moved, to_values @ covariance[k:, k:] @ to_values.T


def likeliest(problem: Problem, fit: Fit) -> Explanation:
    """The explanation at the minimum of its quadratic, all nuisance parameters as wide as this log shows it.

    A fit that stopped short may have nuisance parameters undo half of a value that is as good as nothing.
    """
    q, k = fit.quadratic, len(problem.nuisance)
    shares = _by_share(problem, fit.explanation, fit.steps, q.A, q.b, problem.nuisance_covariance)
    step = max(shares, key=LIKELIHOOD).step
    return parted_from_nuisance(problem, take_step(problem, fit.explanation, step[k:] * fit.steps, step[:k]))


def _by_share(
    problem: Problem,
    explanation: Explanation,
    steps: Floats,
    A: Floats,
    b: Floats,
    whole: Floats,
    measured: Floats | None = None,
) -> Iterator[Minimum]:
    """The minimum by share of the width of nuisance parameters, the whole first; behind them values and scales.

    ``whole`` (k, k) is the covariance of nuisance parameters, and ``measured`` (k, k) the part of it that is as wide as
    it is.
    """
    at = np.zeros(len(b))
    at[: len(problem.nuisance)] = nuisance_now(problem, explanation)
    stiffness = np.ones(len(b) - len(problem.nuisance))
    stiffness[: len(steps)] = value_steps(problem, explanation, steps)[0]
    fixed = np.zeros_like(whole) if measured is None else measured
    for share in NUISANCE_SHARES:
        width = fixed + share**2 * (whole - fixed)
        pull = joint_precision(np.linalg.inv(width), stiffness)
        curvature, slope = A + pull, b - pull @ at
        step = np.linalg.solve(curvature, slope)
        volumes = np.linalg.slogdet(curvature)[1] + np.linalg.slogdet(width)[1]
        yield Minimum(float(0.5 * (slope @ step - at @ pull @ at - volumes)), step, curvature)


def _as_one_number(problem: Problem, fit: Fit) -> Floats:
    """What nuisance parameters and fitted terms do (k + m, k + m), where those of the same number do the same.

    Their slopes differ by rounding alone, and a log that tells the number well would part them by that.
    """
    shared = shared_with_nuisance(problem, fit.explanation)
    k, m = shared.shape
    as_one = np.eye(k + m)
    for order in np.flatnonzero(shared.sum(0) == 1):
        column = int(shared[:, order].argmax())
        as_one[column, column], as_one[k + order, column] = 0.0, 1 / fit.steps[order]
    return as_one


def _of_a_share(problem: Problem, explanation: Explanation) -> Floats:
    """What (m, k) factors gain where nuisance parameters move the vehicle that they multiply: half stays half."""
    own = shared_with_nuisance(problem, explanation).T
    gained = np.zeros_like(own)
    for row, term in enumerate(explanation.fitted):
        parameters, nominal, _ = declared(term.effect, problem.vehicle)
        if own[row].any() and parameters[term.members[0]].is_factor:
            gained[row] = (1 - term.value / nominal[term.members[0]]) * own[row] / own[row].sum()
    return gained
