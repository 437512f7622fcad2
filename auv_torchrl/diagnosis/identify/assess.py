"""What an explanation is worth: chi-square, evidence, the uncertainty of its values, and the step that betters it."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.identify.explanation import Explanation, volume
from auv_torchrl.diagnosis.identify.hypotheses import declared
from auv_torchrl.diagnosis.identify.paths import (
    Fit,
    WindowPath,
    nuisance_now,
    quadratic,
    respond_to_nuisance,
    without_nuisance,
)
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import LONG_STEP, SHORT_STEP
from auv_torchrl.effects import EFFECTS, Origin
from auv_torchrl.sysid.bounded import minimum_within


def value_steps(problem: Problem, explanation: Explanation, steps: Floats) -> tuple[Floats, Floats, Floats]:
    """Prior precision and bounds (m,) of the fitted values, in ``steps`` away from where they are."""
    bounds = [declared(term.effect, problem.vehicle).parameters[term.members[0]] for term in explanation.fitted]
    widths = np.array([problem.prior.width(term.effect, term.members[0]) for term in explanation.fitted])
    room = np.array([
        sorted(((p.low - term.value) / step, (p.high - term.value) / step))
        for p, term, step in zip(bounds, explanation.fitted, steps, strict=True)
    ]).reshape(-1, 2)  # fmt: skip
    return (steps / widths) ** 2, room[:, 0], room[:, 1]


def moved_along(problem: Problem, fit: Fit, amounts: Mapping[int, float], along: bool = True) -> Explanation:
    """The explanation with some numbers, of nuisance parameters or fitted terms, moved by amounts.

    ``amounts`` are by column of the quadratic: nuisance parameters first, then fitted terms. The others go ``along`` as
    fits best, or stay.
    """
    units = np.concatenate([np.ones(len(problem.nuisance)), fit.steps])
    held = dict.fromkeys(range(0 if along else len(units)), 0.0)
    held |= {column: amount / units[column] for column, amount in amounts.items()}
    return take_step(problem, fit.explanation, *bounded_step(problem, fit, held))


def even_step(problem: Problem, fit: Fit) -> tuple[Floats, Floats]:
    """Gauss-Newton step of terms and nuisance parameters in which no nuisance parameter of a threshold moves."""
    return bounded_step(problem, fit, dict.fromkeys(np.flatnonzero(~problem.even).tolist(), 0.0))


def bounded_step(problem: Problem, fit: Fit, held: Mapping[int, float] | None = None) -> tuple[Floats, Floats]:
    """Gauss-Newton step of terms and nuisance parameters, all within their bounds.

    Some columns may be ``held`` at an amount.
    """
    q, steps = fit.quadratic, fit.steps
    k, at = len(problem.nuisance), nuisance_now(problem, fit.explanation)
    stiffness, least, most = value_steps(problem, fit.explanation, steps)
    pull = joint_precision(problem.nuisance_precision, stiffness)
    toward = np.concatenate([-problem.nuisance_precision @ at, np.zeros(len(steps))])
    least_nuisance, most_nuisance = problem.nuisance_bounds
    low, high = np.concatenate([least_nuisance - at, least]), np.concatenate([most_nuisance - at, most])
    x, free = np.zeros(len(low)), np.ones(len(low), bool)
    for column, amount in (held or {}).items():
        x[column], free[column] = amount, False
    step = minimum_within(q.A + pull, q.b + toward, (low, high), x, free)
    return step[k:] * steps, step[:k]


def take_step(problem: Problem, explanation: Explanation, step: Floats, nuisance_step: Floats) -> Explanation:
    """The explanation after a step of its terms and of its nuisance parameters, within bounds."""
    amounts, order = {}, 0
    for place, term in enumerate(explanation.terms):
        if term.discrete:
            continue
        p = declared(term.effect, problem.vehicle).parameters[term.members[0]]
        amounts[place] = float(np.clip(term.value + step[order], p.low, p.high))
        order += 1
    moved = np.clip(nuisance_now(problem, explanation) + nuisance_step, *problem.nuisance_bounds).tolist()
    nuisance = {(effect, member): value for (effect, member, _, _), value in zip(problem.nuisance, moved, strict=True)}
    return replace(explanation.moved(amounts), nuisance=nuisance)


def change_of_chi2(problem: Problem, fit: Fit, step: Floats, nuisance_step: Floats) -> float:
    """What a step of fitted terms and nuisance parameters adds to chi-square, by the quadratic of an explanation."""
    q, at = fit.quadratic, nuisance_now(problem, fit.explanation)
    x = np.concatenate([nuisance_step, step / fit.steps])
    moved = at + nuisance_step
    prior = moved @ problem.nuisance_precision @ moved - at @ problem.nuisance_precision @ at
    return float(x @ q.A @ x - 2 * q.b @ x + prior)


def parted_from_nuisance(problem: Problem, explanation: Explanation) -> Explanation:
    """The same vehicle, where a nuisance parameter that a fitted value changes, too, is as the others let expect.

    The fitted value takes the rest of the change. A fit divides the change between the two at random, because they do
    the same to the samples.
    """
    own = shared_with_nuisance(problem, explanation)
    if not own.any():
        return explanation
    at = nuisance_now(problem, explanation)
    pull = np.linalg.inv(problem.known.nuisance_covariance) if problem.known else problem.nuisance_precision
    by = np.linalg.lstsq(own.T @ pull @ own, own.T @ pull @ at, rcond=None)[0]
    places = [place for place, term in enumerate(explanation.terms) if not term.discrete]
    values = [term.value + amount for term, amount in zip(explanation.fitted, by.tolist(), strict=True)]
    bounds = [declared(term.effect, problem.vehicle).parameters[term.members[0]] for term in explanation.fitted]
    if not all(p.low <= value <= p.high for p, value in zip(bounds, values, strict=True)):
        return explanation
    nuisance = dict(zip([entry[:2] for entry in problem.nuisance], (at - own @ by).tolist(), strict=True))
    return replace(explanation.moved(dict(zip(places, values, strict=True))), nuisance=nuisance)


def shared_with_nuisance(problem: Problem, explanation: Explanation) -> Floats:
    """(k, m) 1 where a nuisance parameter changes a member of a fitted value, and the two add up in all its members."""
    own = np.zeros((len(problem.nuisance), len(explanation.fitted)))
    rows = {entry[:2]: row for row, entry in enumerate(problem.nuisance)}
    for column, term in enumerate(explanation.fitted):
        parameters = declared(term.effect, problem.vehicle).parameters
        if all((term.effect, member) in rows and not parameters[member].loose for member in term.members):
            own[[rows[term.effect, member] for member in term.members], column] = 1.0
    return own


def joint_precision(nuisance: Floats, values: Floats) -> Floats:
    """Prior precision (k + m, k + m) of nuisance parameters, (k, k), and of independent values, (m,)."""
    k = len(nuisance)
    joint = np.zeros((k + len(values), k + len(values)))
    joint[:k, :k] = nuisance
    joint[k:, k:] = np.diag(values)
    return joint


def assess(
    problem: Problem, path: WindowPath, along: Explanation | None = None, before: Fit | None = None
) -> tuple[Fit, Floats, Floats]:
    """Weigh an explanation as it is, with the Gauss-Newton step of its terms and of its nuisance parameters.

    It is that of the path, or one that is fitted along its motion. The responses of nuisance parameters are those of
    the explanation ``before`` it, where there is one: they hardly change on the way down.
    """
    explanation = path.explanation if along is None else along
    changes, steps = term_changes(problem, explanation)
    nuisance_responses = None if before is None else before.nuisance_responses
    if nuisance_responses is None:
        nuisance_responses = respond_to_nuisance(problem, path, explanation)
    q = quadratic(problem, path, changes, along, nuisance_responses, None if along is None else problem.followed)
    at = nuisance_now(problem, explanation)
    chi2 = q.constant + float(at @ problem.nuisance_precision @ at)
    if not np.isfinite(chi2):  # the windows diverge under this vehicle
        nothing = np.zeros(len(explanation.fitted))
        return (
            Fit(explanation, np.inf, -np.inf, np.diag(nothing), path, q, steps, nuisance_responses),
            nothing,
            np.zeros(len(problem.nuisance)),
        )
    _, A = without_nuisance(problem, q, explanation)
    widths = np.array([problem.prior.width(term.effect, term.members[0]) for term in explanation.fitted])
    curvature = A / np.outer(steps, steps)
    covariance = covariance_of_values(curvature, widths)
    evidence = log_evidence(problem, chi2, explanation) + volume(curvature, widths)
    fit = Fit(explanation, chi2, evidence, covariance, path, q, steps, nuisance_responses)
    return fit, *bounded_step(problem, fit)


def covariance_of_values(curvature: Floats, widths: Floats) -> Floats:
    """Covariance (k, k) of values, nuisance parameters fitted, by their curvature (k, k) and prior ``widths`` (k,).

    What nuisance parameters take of a curvature is taken by subtraction: where it takes all, rounding may leave less
    than nothing.
    """
    size, directions = np.linalg.eigh(curvature * np.outer(widths, widths))
    covariance: Floats = (directions / (1.0 + np.maximum(size, 0.0))) @ directions.T * np.outer(widths, widths)
    return covariance


def term_changes(problem: Problem, explanation: Explanation) -> tuple[list[Explanation], Floats]:
    """The explanation with each fitted term moved a little, and by how much."""
    moved, steps = [], []
    nuisance_steps = {parameter[:2]: problem.nuisance_step(parameter) for parameter in problem.nuisance}
    for place, term in enumerate(explanation.terms):
        if term.discrete:
            continue
        p = declared(term.effect, problem.vehicle).parameters[term.members[0]]
        share = LONG_STEP if EFFECTS[term.effect].origin is Origin.ACTUATION else SHORT_STEP
        step = share * problem.prior.width(term.effect, term.members[0])
        if (term.effect, term.members[0]) in nuisance_steps:  # the same step, so that the two are the same direction
            step = nuisance_steps[term.effect, term.members[0]]
        if term.value + step > p.high:
            step = -step
        moved.append(explanation.moved({place: term.value + step}))
        steps.append(step)
    return moved, np.array(steps)


def log_evidence(problem: Problem, chi2: float, explanation: Explanation) -> float:
    """Log evidence less the volume of the fitted values."""
    return -0.5 * chi2 + problem.prior.structure(explanation)
