"""What an explanation is worth: chi-square, evidence, the uncertainty of its values, and the step that betters it."""

from collections.abc import Iterator

import numpy as np

from auv_torchrl.diagnosis.identify.declared import declared
from auv_torchrl.diagnosis.identify.evidence import volume
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.judged import Base, Judged, slack_now
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.quadratics import mark_slack, quadratic, without_slack
from auv_torchrl.diagnosis.identify.steps import (
    bounded_step,
    joint_precision,
    parted_from_slack,
    shared_with_slack,
    take_step,
    value_steps,
)
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import KNOB_STEP, LONG_STEP, SLACK_SHARES
from auv_torchrl.effects import EFFECTS, Origin


def assess(
    problem: Problem, base: Base, sketched: Explanation | None = None, before: Judged | None = None
) -> tuple[Judged, Floats, Floats]:
    """Weigh an explanation as it is, with the Gauss-Newton step of its knobs and of its slack.

    It is that of the base, or one that is ``sketched`` along its motion. The marks of slack are those of the
    explanation ``before`` it, where there is one: they hardly change on the way down.
    """
    explanation = base.explanation if sketched is None else sketched
    changes, steps = knob_changes(problem, explanation)
    slack_marks = None if before is None else before.slack_marks
    if slack_marks is None:
        slack_marks = mark_slack(problem, base, explanation)
    q = quadratic(problem, base, changes, sketched, slack_marks, None if sketched is None else problem.followed)
    at = slack_now(problem, explanation)
    chi2 = q.constant + float(at @ problem.slack_precision @ at)
    if not np.isfinite(chi2):  # the windows diverge under this vehicle
        nothing = np.zeros(len(explanation.fitted))
        return (
            Judged(explanation, np.inf, -np.inf, np.diag(nothing), base, q, steps, slack_marks),
            nothing,
            np.zeros(len(problem.slack)),
        )
    _, _, A, _, _ = without_slack(problem, q, explanation)
    widths = np.array([problem.prior.width(knob.effect, knob.members[0]) for knob in explanation.fitted])
    curvature = A / np.outer(steps, steps)
    covariance = covariance_of_values(curvature, widths)
    evidence = log_evidence(problem, chi2, explanation) + volume(curvature, widths)
    judged = Judged(explanation, chi2, evidence, covariance, base, q, steps, slack_marks)
    return judged, *bounded_step(problem, judged)


def covariance_of_values(curvature: Floats, widths: Floats) -> Floats:
    """Covariance (k, k) of values by their curvature (k, k), slack fitted, and the ``widths`` (k,) of their prior.

    What slack takes of a curvature is taken by subtraction: where it takes all, rounding may leave less than nothing.
    """
    size, directions = np.linalg.eigh(curvature * np.outer(widths, widths))
    covariance: Floats = (directions / (1.0 + np.maximum(size, 0.0))) @ directions.T * np.outer(widths, widths)
    return covariance


def as_sure(problem: Problem, judged: Judged) -> tuple[Explanation, Floats]:
    """The explanation with its values, and their covariance (m, m), where slack is as wide as this log shows it.

    Its share of the width that slack may have is the likeliest one (type II maximum likelihood): of a vehicle that
    is as its file says, the log shows that, and tells the values of an effect better. What healthy flights leave open
    of the vehicle has been measured, and is as wide as it is, also where a fit held it because its log tells nothing of
    it: a value may hang on it. Values move by what the other width does to them: where an explanation is not at the
    minimum of its quadratic, its fit has found that the minimum is no better.
    """
    explanation, as_one = parted_from_slack(problem, judged.explanation), _as_one_number(problem, judged)
    A, b = as_one.T @ judged.quadratic.A @ as_one, as_one.T @ judged.quadratic.b
    fitted, known = problem.slack_covariance, problem.known
    width, measured = (known.slack_covariance, known.shrinks) if known else (fitted, None)
    _, at_fit, _ = next(_by_share(problem, explanation, judged.steps, A, b, fitted))
    shares = _by_share(problem, explanation, judged.steps, A, b, width, measured)
    _, step, curvature = max(shares, key=lambda share: share[0])
    k, by = len(problem.slack), step - at_fit
    said = take_step(problem, explanation, by[k:] * judged.steps, by[:k])
    return said, np.linalg.inv(curvature)[k:, k:] * np.outer(judged.steps, judged.steps)


def likeliest(problem: Problem, judged: Judged) -> Explanation:
    """The explanation at the minimum of its quadratic, all slack as wide as this log shows it.

    A fit that stopped short may have slack undo half of a value that is as good as nothing.
    """
    q, k = judged.quadratic, len(problem.slack)
    shares = _by_share(problem, judged.explanation, judged.steps, q.A, q.b, problem.slack_covariance)
    step = max(shares, key=lambda share: share[0])[1]
    return parted_from_slack(problem, take_step(problem, judged.explanation, step[k:] * judged.steps, step[:k]))


def _by_share(
    problem: Problem,
    explanation: Explanation,
    steps: Floats,
    A: Floats,
    b: Floats,
    whole: Floats,
    measured: Floats | None = None,
) -> Iterator[tuple[float, Floats, Floats]]:
    """By share of the width of slack, the whole first: log likelihood, step to the minimum, and curvature there.

    ``whole`` (k, k) is the covariance of slack, and ``measured`` (k, k) the part of it that is as wide as it is.
    """
    at = np.concatenate([slack_now(problem, explanation), np.zeros(len(steps))])
    stiffness = value_steps(problem, explanation, steps)[0]
    fixed = np.zeros_like(whole) if measured is None else measured
    for share in SLACK_SHARES:
        width = fixed + share**2 * (whole - fixed)
        pull = joint_precision(np.linalg.inv(width), stiffness)
        curvature, slope = A + pull, b - pull @ at
        step = np.linalg.solve(curvature, slope)
        volumes = np.linalg.slogdet(curvature)[1] + np.linalg.slogdet(width)[1]
        yield float(0.5 * (slope @ step - at @ pull @ at - volumes)), step, curvature


def _as_one_number(problem: Problem, judged: Judged) -> Floats:
    """What slack and fitted knobs do (k + m, k + m), where slack of a number that a knob has does what the knob does.

    Their slopes differ by rounding alone, and a log that tells the number well would part them by that.
    """
    shared = shared_with_slack(problem, judged.explanation)
    k, m = shared.shape
    as_one = np.eye(k + m)
    for order in np.flatnonzero(shared.sum(0) == 1):
        column = int(shared[:, order].argmax())
        as_one[column, column], as_one[k + order, column] = 0.0, 1 / judged.steps[order]
    return as_one


def knob_changes(problem: Problem, explanation: Explanation) -> tuple[list[Explanation], Floats]:
    """The explanation with each fitted knob moved a little, and by how much."""
    moved, steps = [], []
    at_slack = {parameter[:2]: problem.slack_step(parameter) for parameter in problem.slack}
    for place, knob in enumerate(explanation.knobs):
        if knob.discrete:
            continue
        p = declared(knob.effect, problem.vehicle).parameters[knob.members[0]]
        share = LONG_STEP if EFFECTS[knob.effect].origin is Origin.ACTUATION else KNOB_STEP
        step = share * problem.prior.width(knob.effect, knob.members[0])
        if (knob.effect, knob.members[0]) in at_slack:  # the same step, so that the two are the same direction
            step = at_slack[knob.effect, knob.members[0]]
        if knob.value + step > p.high:
            step = -step
        moved.append(explanation.moved({place: knob.value + step}))
        steps.append(step)
    return moved, np.array(steps)


def log_evidence(problem: Problem, chi2: float, explanation: Explanation) -> float:
    """Log evidence less the volume of the fitted values."""
    return -0.5 * chi2 + problem.prior.structure(explanation)
