"""Explanations with fewer values: what the slack of coefficients can take is no finding.

Slack bends a log as effects do, and where much of the motion is unseen its fit takes many steps. An explanation without
some value that is fitted from afar may stop short of what it can do, and the value would look needed. So it is also
fitted from where the explanation with the value is.
"""

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.identify.assess import assess
from auv_torchrl.diagnosis.identify.declared import declared
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.fit import fit_by_simulation
from auv_torchrl.diagnosis.identify.following import nudge
from auv_torchrl.diagnosis.identify.judged import Judged, leaves_much, slack_now
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.steps import bounded_step, take_step
from auv_torchrl.diagnosis.thresholds import CONTENDS, FITTED_ON, SHOWS, STILL_GAINS


def left_to_slack(problem: Problem, judged: Judged, places: Collection[int], costs: float = SHOWS) -> Judged | None:
    """An explanation without the fitted knobs at some places, fitted from where it is; None where the log forbids that.

    It does so where its own quadratic says that slack cannot take what those knobs do, but for ``costs`` of chi-square:
    from its minimum on, for what a fit that stopped before it would still gain is no merit of having fewer knobs.
    """
    knobs = judged.explanation.knobs
    if any(knobs[place].discrete for place in places) or not np.isfinite(judged.chi2):
        return None
    order = {place: i for i, place in enumerate(p for p, knob in enumerate(knobs) if not knob.discrete)}
    nominal = {p: declared(knobs[p].effect, problem.vehicle).nominal[knobs[p].members[0]] for p in places}
    k = len(problem.slack)
    held = {k + order[p]: (nominal[p] - knobs[p].value) / judged.steps[order[p]] for p in places}
    step, slack_step = bounded_step(problem, judged, held)
    if _changes(problem, judged, step, slack_step) - _changes(problem, judged, *bounded_step(problem, judged)) > costs:
        return None
    moved = take_step(problem, judged.explanation, step, slack_step)
    kept = tuple(knob for place, knob in enumerate(moved.knobs) if place not in places)
    fewer = fit_by_simulation(problem, Explanation(kept, moved.slack), judged.base)
    near, *_ = assess(problem, nudge(problem, Explanation(kept, moved.slack), judged.base))
    if near.evidence > fewer.evidence:  # windows are where they were with the value: elsewhere some are lost
        fewer = replace(near, slack_marks=None)
    if leaves_much(problem, judged) and fewer.evidence < judged.evidence - CONTENDS:  # windows were lost on the way
        return fewer
    return until_still(problem, fewer)


def until_still(problem: Problem, judged: Judged) -> Judged:
    """An explanation fitted on while that gains something, in units of what it leaves anyway."""
    for _ in range(FITTED_ON):
        further = fit_by_simulation(problem, judged.explanation, judged.base)
        left = max(1.0, judged.excess)
        if not further.evidence > judged.evidence + STILL_GAINS * left:
            break
        judged = further
    return judged


def _changes(problem: Problem, judged: Judged, step: np.ndarray, slack_step: np.ndarray) -> float:
    """What a step of the fitted knobs and of slack adds to chi-square, by the quadratic of an explanation."""
    q, at = judged.quadratic, slack_now(problem, judged.explanation)
    x = np.concatenate([slack_step, step / judged.steps])
    moved = at + slack_step
    prior = moved @ problem.slack_precision @ moved - at @ problem.slack_precision @ at
    return float(x @ q.A @ x - 2 * q.b @ x + prior)
