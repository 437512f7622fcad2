"""Take out of an explanation what the log does not need, and say the rest in the fewest values."""

from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.identify.declared import declared
from auv_torchrl.diagnosis.identify.explanation import Knob
from auv_torchrl.diagnosis.identify.fit import fit_along_motion, fit_by_simulation
from auv_torchrl.diagnosis.identify.judged import Judged, leaves_much, slack_does, spread, strained
from auv_torchrl.diagnosis.identify.leaner import left_to_slack
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.refine import from_another
from auv_torchrl.diagnosis.identify.screen import Field, Screened
from auv_torchrl.diagnosis.identify.small import are_small, is_minor, small_members
from auv_torchrl.diagnosis.identify.steps import parted_from_slack
from auv_torchrl.diagnosis.thresholds import EVIDENCE_SLIP, IDLE, MISSED, TIE, WORTH_AN_EFFECT
from auv_torchrl.effects import EFFECTS


def tidy(problem: Problem, best: Judged, polished: list[Judged]) -> Judged:
    """Take out what the log does not need, and name what is left as simply as it allows; adds what was simulated."""
    best = _prune(problem, best, polished)
    best = _leave_out_small(problem, best, polished)
    best = _drop_idle(problem, best, polished)
    best = _leave_to_slack(problem, best, polished)
    if not best.nothing_left:
        polished.append(fit_by_simulation(problem, best.explanation, best.base))
        best = max(best, polished[-1], key=lambda judged: judged.evidence)
    best = _exchanged(problem, best, polished)
    return _said_otherwise(problem, _simplest(problem, best, polished), polished)


def _prune(problem: Problem, best: Judged, polished: list[Judged]) -> Judged:
    """Take out effects for which the log does not pay, and what slack would do where nothing is left without it."""
    while len(best.explanation.effects) > 1:
        fewer = [_without(problem, best, effect) for effect in best.explanation.effects]
        polished += fewer
        each = zip(fewer, are_small(problem, best), strict=True)
        needless = [one for one, is_small in each if is_small and _suffices(problem, one, best)]
        if needless:
            best = max(needless, key=lambda judged: judged.evidence)
            polished[:] = [judged for judged in polished if not _is_fuller(judged, best)]
            continue
        better = max(fewer, key=lambda judged: judged.evidence)
        if better.evidence <= best.evidence - WORTH_AN_EFFECT:
            return best
        best = better
    return best


def _is_fuller(judged: Judged, best: Judged) -> bool:
    """Whether an explanation has the effects of the best one, and others that it does not need."""
    return bool(best.explanation.effects) and set(judged.explanation.effects) > set(best.explanation.effects)


def _leave_out_small(problem: Problem, best: Judged, polished: list[Judged]) -> Judged:
    """Take out small values of single thrusters or axes, beside others, that slack suffices without.

    Healthy flights say what such values differ by among themselves; beside a fault, that is no finding either.
    """
    while problem.known is not None and not problem.known.of_itself:
        tried = [left_to_slack(problem, best, [place], np.inf) for place in small_members(problem, best)]
        fewer = [judged for judged in tried if judged is not None]
        enough = [one for one in fewer if _suffices(problem, one, best) and _slack_takes_it(problem, one)]
        if not enough:
            break
        best = max(enough, key=lambda judged: judged.evidence)
        polished.append(best)
    return best


def _slack_takes_it(problem: Problem, judged: Judged) -> bool:
    """Whether slack explains the log beside the values as they are said, each number and all together likely."""
    said = replace(judged, explanation=parted_from_slack(problem, judged.explanation))
    return slack_does(problem, judged) and not strained(problem, said)


def _suffices(problem: Problem, judged: Judged, fuller: Judged) -> bool:
    """Whether nothing is left, or of a vehicle whose file was mended no more than its physics may be wrong by.

    Where no healthy log tells the disturbance, a fuller explanation must not leave less than that, either.
    """
    if problem.known is None:
        return judged.nothing_left and judged.chi2 < fuller.chi2 + spread(judged)
    return judged.nothing_left or (problem.known.scales is not None and not leaves_much(problem, judged))


def _without(problem: Problem, best: Judged, effect: str) -> Judged:
    """The explanation without an effect, simulated where a sketch does not show that it is far worse."""
    sketch = fit_along_motion(problem, best.explanation.without(effect), best.base)
    far = sketch.chi2 > best.chi2 + MISSED * sketch.quadratic.numbers
    return sketch if far else fit_by_simulation(problem, sketch.explanation, best.base)


def _drop_idle(problem: Problem, best: Judged, polished: list[Judged]) -> Judged:
    """Take out values that stand where they would without the effect."""
    slack = {(effect, member): width for effect, member, _, width in problem.slack}
    deviation = iter(np.sqrt(np.diag(best.covariance)))
    kept = []
    for knob in best.explanation.knobs:
        if knob.discrete:
            kept.append(knob)
            continue
        nominal = declared(knob.effect, problem.vehicle).nominal[knob.members[0]]
        doubt = max(float(next(deviation)), slack.get((knob.effect, knob.members[0]), 0.0))
        if abs(knob.value - nominal) > IDLE * doubt:
            kept.append(knob)
    if not kept or len(kept) == len(best.explanation.knobs):
        return best
    fewer = fit_by_simulation(problem, replace(best.explanation, knobs=tuple(kept)), best.base)
    polished.append(fewer)
    return fewer if fewer.evidence > best.evidence - WORTH_AN_EFFECT else best


def _leave_to_slack(problem: Problem, best: Judged, polished: list[Judged]) -> Judged:
    """Take out values, one after the other, that slack can take, as long as another one is left."""
    while len(best.explanation.knobs) > 1:
        tried = (left_to_slack(problem, best, [place]) for place in range(len(best.explanation.knobs)))
        fewer = [judged for judged in tried if judged is not None]
        polished += fewer
        better = max(fewer, key=lambda judged: judged.evidence, default=best)
        if better.evidence <= best.evidence:
            return best
        best = better
    return best


def _exchanged(problem: Problem, best: Judged, polished: list[Judged]) -> Judged:
    """Try in place of each of several effects the one that is the likeliest beside the others."""
    if len(best.explanation.effects) < 2 or leaves_much(problem, best):
        return best
    tried = {frozenset(judged.explanation.effects) for judged in polished}
    others = (_likeliest_instead(problem, best, effect, tried) for effect in best.explanation.effects)
    likely = [other for other in others if other and other.evidence > best.evidence - EVIDENCE_SLIP]
    fresh = [fit_by_simulation(problem, other.explanation, best.base) for other in likely]
    polished += fresh
    winner = max((j for j in fresh if not is_minor(problem, j)), key=lambda judged: judged.evidence, default=best)
    if winner.evidence <= best.evidence:
        return best
    polished.append(from_another(problem, best, winner))
    return max(polished[-1], _drop_idle(problem, winner, polished), key=lambda judged: judged.evidence)


def _likeliest_instead(problem: Problem, best: Judged, effect: str, tried: set[frozenset[str]]) -> Screened | None:
    """The explanation with another effect in place of one, of those that were not tried; None where there is none."""
    field = Field.of(problem, best.base, best.explanation.without(effect))
    for screened in field.families():
        effects = frozenset(screened.explanation.effects)
        added = effects - set(best.explanation.effects)
        if added and effects not in tried and added | {effect} not in field.twins:
            return screened
    return None


def _simplest(problem: Problem, best: Judged, polished: list[Judged]) -> Judged:
    """Of what fits about as well as the best, the one with the fewest values, by effects that have the fewest."""
    close = [
        j for j in polished if j.explanation.effects and j.evidence > best.evidence - TIE and not is_minor(problem, j)
    ]
    if not best.explanation.effects:
        return best

    def size(judged: Judged) -> tuple[int, int, float]:
        declared = sum(len(EFFECTS[name].parameters) for name in judged.explanation.effects)
        return len(judged.explanation.knobs), declared, -judged.evidence

    return min([best, *close], key=size)


def _said_otherwise(problem: Problem, best: Judged, polished: list[Judged]) -> Judged:
    """Where a value makes the same vehicle as a plainer one of another effect, say that.

    No slope tells one such value from another, so that its evidence pays for no value, and its interval is of no use.
    """
    looked_for = {atom.effect for atom in problem.atoms}

    def plainer(knob: Knob) -> Knob | None:
        same_as = EFFECTS[knob.effect].same_as
        told = [same_as(best.base.vehicle, member, knob.value) if same_as else None for member in knob.members]
        known = [same for same in told if same is not None and same[0] in looked_for]
        if len(known) < len(told):
            return None
        return Knob(known[0][0], tuple(member for _, member, _ in known), known[0][2])

    if not any(plainer(knob) for knob in best.explanation.knobs):
        return best
    knobs = tuple(plainer(knob) or knob for knob in best.explanation.knobs)
    said = fit_by_simulation(problem, replace(best.explanation, knobs=knobs), best.base)
    polished[:] = [said, *(j for j in polished if not any(plainer(knob) for knob in j.explanation.knobs))]
    return said
