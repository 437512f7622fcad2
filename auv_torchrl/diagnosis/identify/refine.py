"""Refine the best explanation: add and take out effects while the log pays, and say it in the fewest values."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.identify.declared import declared
from auv_torchrl.diagnosis.identify.explanation import Knob
from auv_torchrl.diagnosis.identify.fit import fit_along_motion, fit_by_simulation
from auv_torchrl.diagnosis.identify.judged import (
    Judged,
    are_small,
    is_minor,
    is_strained,
    leaves_much,
    spread,
)
from auv_torchrl.diagnosis.identify.leaner import left_to_slack
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.screen import Field, Screened
from auv_torchrl.diagnosis.thresholds import (
    CLOSES,
    EVIDENCE_SLIP,
    FURTHER_TRIED,
    IDLE,
    MISSED,
    MOST_EFFECTS,
    TIE,
    WITHIN,
    WORTH_AN_EFFECT,
)
from auv_torchrl.effects import EFFECTS

Progress = Callable[[str, float], None]


def explains(problem: Problem, judged: Judged) -> bool:
    """Whether an explanation leaves little, and not because slack makes up for what it lacks."""
    return not leaves_much(problem, judged) and not is_strained(problem, judged)


def from_another(problem: Problem, judged: Judged, other: Judged) -> Judged:
    """An explanation, or its fit from the slack and shared values of another where that is better: it may be stuck."""
    trial = fit_by_simulation(problem, judged.explanation.starting_from(other.explanation), other.base)
    return trial if trial.evidence > judged.evidence else judged


def _is_done(problem: Problem, judged: Judged) -> bool:
    """Whether an explanation leaves nothing, with slack that is likely."""
    return judged.nothing_left and not is_strained(problem, judged)


def _must_close(problem: Problem, judged: Judged) -> float:
    """Chi-square that a further effect must take away: much of what is left, and where that is nothing, no chance."""
    if leaves_much(problem, judged):
        return CLOSES * (judged.chi2 - judged.quadratic.numbers)
    return spread(judged) if _is_done(problem, judged) else 0.0


def is_worth_a_look(problem: Problem, judged: Judged) -> bool:
    """Whether an explanation leaves what a further effect could do.

    Without a healthy log the floor is an assumption: where less acts, a small effect hides in it beside a large one.
    """
    hides = problem.known is None and bool(judged.explanation.effects)
    return hides or not _is_done(problem, judged)


def grow(
    problem: Problem, best: Judged, polished: list[Judged], twins: set[frozenset[str]], progress: Progress
) -> Judged:
    """Add effects while the log pays; those that are the same by another name (``twins``) stay out.

    Further values of effects that are there are tried whatever else promises more: they are no further effect.
    """
    while len(best.explanation.effects) < MOST_EFFECTS:
        progress("looking for further effects", 0.7 + 0.05 * len(best.explanation.effects))
        field = Field.of(problem, best.base)
        here = field.none().evidence
        twins_of = {name for pair in twins for name in pair if pair & set(best.explanation.effects)}
        added = [(s, set(s.explanation.effects) - set(best.explanation.effects)) for s in field.families()]
        tried = 1 if explains(problem, best) else FURTHER_TRIED
        ahead = [screened for screened, new in added if not new & twins_of][:tried]
        closes = _must_close(problem, best)
        least = max(here + WORTH_AN_EFFECT, ahead[0].evidence - WITHIN * (ahead[0].evidence - here)) if ahead else 0.0
        within = [screened for screened, new in added if not new and screened not in ahead]
        likely = [s for s in ahead if s.evidence > least]
        likely += [s for s in within if s.evidence > here + WORTH_AN_EFFECT]
        trials = [s for s in likely if field.constant - s.chi2 > closes]
        fresh = [fit_by_simulation(problem, s.explanation, best.base) for s in trials]
        polished += fresh
        better = max((j for j in fresh if not is_minor(problem, j)), key=lambda judged: judged.evidence, default=best)
        if better.evidence <= best.evidence + WORTH_AN_EFFECT or best.chi2 - better.chi2 < closes:
            return best
        best = better
        if not is_worth_a_look(problem, best):
            return best
    return best


def tidy(problem: Problem, best: Judged, polished: list[Judged]) -> Judged:
    """Take out what the log does not need, and name what is left as simply as it allows; adds what was simulated."""
    best = _prune(problem, best, polished)
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
            continue
        better = max(fewer, key=lambda judged: judged.evidence)
        if better.evidence <= best.evidence - WORTH_AN_EFFECT:
            return best
        best = better
    return best


def _suffices(problem: Problem, judged: Judged, fuller: Judged) -> bool:
    """Whether nothing is left, or of a vehicle whose file was mended no more than its physics may be wrong by.

    Where no healthy log tells the disturbance, a fuller explanation must not leave less than that, either.
    """
    if problem.known is None:
        return judged.nothing_left and judged.chi2 < fuller.chi2 + spread(judged)
    return judged.nothing_left or (problem.known.scale > 0 and not leaves_much(problem, judged))


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
