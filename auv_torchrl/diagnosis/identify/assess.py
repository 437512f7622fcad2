"""What an explanation is worth: chi-square, evidence, the uncertainty of its values, and the step that betters it."""

import numpy as np

from auv_torchrl.diagnosis.identify.declared import declared
from auv_torchrl.diagnosis.identify.evidence import volume
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.paths import Fit, WindowPath, nuisance_now
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.quadratics import quadratic, respond_to_nuisance, without_nuisance
from auv_torchrl.diagnosis.identify.steps import bounded_step
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import LONG_STEP, SHORT_STEP
from auv_torchrl.effects import EFFECTS, Origin


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
    at_slack = {parameter[:2]: problem.nuisance_step(parameter) for parameter in problem.nuisance}
    for place, term in enumerate(explanation.terms):
        if term.discrete:
            continue
        p = declared(term.effect, problem.vehicle).parameters[term.members[0]]
        share = LONG_STEP if EFFECTS[term.effect].origin is Origin.ACTUATION else SHORT_STEP
        step = share * problem.prior.width(term.effect, term.members[0])
        if (term.effect, term.members[0]) in at_slack:  # the same step, so that the two are the same direction
            step = at_slack[term.effect, term.members[0]]
        if term.value + step > p.high:
            step = -step
        moved.append(explanation.moved({place: term.value + step}))
        steps.append(step)
    return moved, np.array(steps)


def log_evidence(problem: Problem, chi2: float, explanation: Explanation) -> float:
    """Log evidence less the volume of the fitted values."""
    return -0.5 * chi2 + problem.prior.structure(explanation)
