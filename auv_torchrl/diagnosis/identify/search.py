"""Find the explanation: screen everything, polish what could be it, refine the best."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.identify.agreeing_sensor import follow_agreeing
from auv_torchrl.diagnosis.identify.candidates import Others, candidates_of
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.fit import fit_by_simulation, measure_noise, reassess, rescued
from auv_torchrl.diagnosis.identify.found import Found
from auv_torchrl.diagnosis.identify.judged import (
    Base,
    Judged,
    leaves_much,
    log_likelihood,
    slack_does,
)
from auv_torchrl.diagnosis.identify.leaner import left_to_slack, until_still
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.refine import Progress, explains, from_another, grow, is_worth_a_look
from auv_torchrl.diagnosis.identify.screen import Field, Screened
from auv_torchrl.diagnosis.identify.sketches import is_near
from auv_torchrl.diagnosis.identify.small import is_minor
from auv_torchrl.diagnosis.identify.tidy import tidy
from auv_torchrl.diagnosis.thresholds import (
    BROKEN_PROMISE,
    CONTENDS,
    FEW_VALUES,
    HOPELESS,
    LITTLE,
    MANY_WINDOWS,
    POLISHED,
    REFITTED,
    SEARCHED_WINDOWS,
    TURNED_ROUND,
    WORTH_AN_EFFECT,
)


def search(
    problem: Problem,
    follow: Base,
    progress: Progress,
    hints: Sequence[Explanation] = (),
    others: Others = Others.ALL,
    below: float = np.inf,
) -> Found:
    """Explain the windows of a problem that ``follow`` has followed, in as many values as it took, see :func:`tidied`.

    ``hints`` are simulated first, and ``others`` that the screening finds only where none of the hints explains the log
    by a few values, and where they promise to leave less than ``below`` of chi-square per number. Of many windows, some
    are searched, and what is found is fitted to all.
    """
    if len(problem.windows) <= MANY_WINDOWS:
        return _search(problem, follow, progress, hints, others, below)
    rows = np.linspace(0, len(problem.windows) - 1, SEARCHED_WINDOWS).astype(int)
    few = Problem.of(problem.given.subset(rows), problem.vehicle, problem.settings, problem.known)
    found = tidied(_search(*follow_agreeing(few), progress, hints, others, below))
    return _refit(problem, follow, found, progress)


def tidied(found: Found, rival: float = -np.inf) -> Found:
    """What was found, its best explanation said as simply as the log allows, where it is not far behind a ``rival``.

    The log likelihood of a rival is that of the best explanation of the same log by another vehicle.
    """
    problem, best, polished = found.problem, found.best, list(found.polished)
    left = max(1.0, best.excess)
    if log_likelihood(problem, best) > rival - CONTENDS * left:
        best = tidy(problem, best, polished)
    none = _nothing(problem, best)
    if none is None or not none.evidence > found.none.evidence:
        none = found.none
    elif not best.evidence > none.evidence + WORTH_AN_EFFECT:  # what is left of effects does nothing
        best, polished = none, list(found.polished)
    polished = [none, *(judged for judged in polished if judged is not found.none and judged is not none)]
    problem.freedoms.clear()
    kept = (judged if judged is best or judged is none else _set_aside(judged) for judged in polished)
    return replace(found, none=none, best=best, polished=sorted(kept, key=lambda judged: -judged.evidence))


def _refit(problem: Problem, follow: Base, found: Found, progress: Progress) -> Found:
    """What was ``found`` among some windows, fitted to all of them; effects are added where these show more."""
    field = Field.of(problem, follow)
    hopeless = _is_hopeless(found.none, found.none.quadratic.numbers, found.best.evidence)
    polished = [fit_by_simulation(problem, found.none.explanation, follow, rounds=0 if hopeless else 4)]
    problem = replace(problem, slack_suffices=slack_does(problem, polished[0]))
    others = [judged for judged in found.polished if judged.explanation.effects and judged is not found.best]
    chosen = [found.best, *others] if found.best.explanation.effects else others
    polished += [fit_by_simulation(problem, judged.explanation, follow) for judged in chosen[: 1 + REFITTED]]
    few_left_much = leaves_much(found.problem, found.best)
    return _finish(problem, follow, field, field.families(), polished, found.promise, few_left_much, progress)


def _is_hopeless(none: Screened | Judged, numbers: int, best: float) -> bool:
    """Whether "no gap" is so far behind the evidence of the ``best``, and leaves so much, that no slack helps it."""
    return none.evidence < best - HOPELESS and not is_near(none.chi2, numbers)


def _search(
    problem: Problem,
    follow: Base,
    progress: Progress,
    hints: Sequence[Explanation],
    others: Others,
    below: float,
) -> Found:
    field = Field.of(problem, follow)
    families = field.families()
    progress("screening effects", 0.4)
    hopeless = bool(families) and _is_hopeless(field.none(), field.quadratic.numbers, families[0].evidence)
    polished = [fit_by_simulation(problem, Explanation(), follow, rounds=0 if hopeless else 4)]  # then with effects
    if not hopeless:
        polished = [rescued(problem, polished[0], follow)]
    problem = replace(problem, slack_suffices=slack_does(problem, polished[0]))
    promise = np.inf
    followed = [follow.explanation] if follow.explanation.effects and follow.explanation not in hints else []
    for explanation in (*followed, *hints):
        polished.append(rescued(problem, fit_by_simulation(problem, explanation, follow), follow))
        few = len(explanation.knobs) <= FEW_VALUES or polished[-1].nothing_left
        if others is not Others.NONE and few and explains(problem, polished[-1]):
            break
    else:
        candidates: Sequence[Screened | Judged] = ()
        if others is not Others.NONE:
            one_does = any(len(j.explanation.effects) == 1 and explains(problem, j) for j in polished[1:])
            others, below = (Others.SINGLE, np.inf) if one_does else (others, below)
            candidates, promise = candidates_of(problem, follow, field, families, others)
            candidates = [shown for shown in candidates if not any(_adds_to(hint, shown) for hint in hints)]
        for shown in candidates if promise < below else ():
            enough = TURNED_ROUND * min(judged.chi2 for judged in polished)
            polished.append(_simulated(problem, shown, follow, families, enough))
            progress("fitting candidates", min(0.7, 0.4 + 0.3 * len(polished) / POLISHED))
    return _finish(problem, follow, field, families, polished, promise, below <= promise < np.inf, progress)


def _finish(
    problem: Problem,
    follow: Base,
    field: Field,
    families: list[Screened],
    polished: list[Judged],
    promise: float,
    given_up: bool,
    progress: Progress,
) -> Found:
    """The best of what was simulated, with effects added, unless that is ``given_up``."""
    best = _best(problem, polished)
    if (anew := measure_noise(problem, best)) is not problem:
        problem = anew
        polished = [reassess(problem, judged) if np.isfinite(judged.chi2) else judged for judged in polished]
        best = _best(problem, polished)
    if problem.layout.felt.any():  # much of the motion is free: until nothing moves, a quadratic says little
        still = until_still(problem, best)
        best, polished = still, [still if judged is best else judged for judged in polished]
    problem, polished = _without_effects(problem, best, polished)
    best = _best(problem, polished)
    if not leaves_much(problem, best):
        polished = _fitted_on(problem, best, polished, field.twins)
        best = _best(problem, polished)
    if not given_up and is_worth_a_look(problem, best):
        best = grow(problem, best, polished, field.twins, progress)
    ranked = sorted(polished, key=lambda judged: -judged.evidence)
    return Found(problem, follow, polished[0], best, ranked, families, field, promise)


def _set_aside(judged: Judged) -> Judged:
    """An explanation that lost: what it was worth and the motion under it, without the slopes that fill the memory."""
    return replace(judged, base=judged.base.without_slopes(), slack_marks=None)


def _adds_to(hint: Explanation, shown: Screened | Judged) -> bool:
    """Whether a candidate has several effects that were simulated already, and more, which is added if it pays."""
    return len(hint.effects) > 1 and set(hint.effects) < set(shown.explanation.effects)


def _simulated(
    problem: Problem, shown: Screened | Judged, follow: Base, families: list[Screened], enough: float
) -> Judged:
    """A candidate fitted; several effects that end far from what they promised, also from what each would be alone."""
    judged = fit_by_simulation(problem, shown.explanation, follow, enough=enough)
    judged = rescued(problem, judged, follow, enough)
    if len(shown.explanation.effects) == 1 or not judged.chi2 > BROKEN_PROMISE * shown.chi2:
        return judged
    again = fit_by_simulation(problem, _each_alone(shown.explanation, families), follow, enough=enough)
    return max(judged, again, key=lambda judged: judged.evidence)


def _each_alone(explanation: Explanation, families: list[Screened]) -> Explanation:
    """The same effects, each with the values that it would have alone."""
    alone = [s.explanation for s in families if set(s.explanation.effects) <= set(explanation.effects)]
    return Explanation(tuple(knob for single in alone for knob in single.knobs))


def _fitted_on(problem: Problem, best: Judged, polished: list[Judged], twins: set[frozenset[str]]) -> list[Judged]:
    """What may still win is fitted until nothing moves: a fit that leaves nothing is good, but not yet the best.

    "No effect" may, however far behind it is, where slack suffices to explain the log.
    """

    def contends(judged: Judged) -> bool:
        if judged is polished[0] and problem.slack_suffices:
            return True
        own, its = set(best.explanation.effects), set(judged.explanation.effects)
        if own < its and best.nothing_left:  # no effect more is needed
            return False
        return own != its and frozenset(own ^ its) not in twins and judged.evidence > best.evidence - CONTENDS

    rivals = [judged for judged in polished if contends(judged)]
    if not rivals or not best.explanation.effects:
        return polished
    fitted = {id(best): until_still(problem, best)}
    for rival in rivals:
        fitted[id(rival)] = until_still(problem, from_another(problem, rival, fitted[id(best)]))
    return [fitted.get(id(judged), judged) for judged in polished]


def _without_effects(problem: Problem, best: Judged, polished: list[Judged]) -> tuple[Problem, list[Judged]]:
    """What was simulated, "no effect" first, fitted anew where it may do as well as the best."""
    nothing = _nothing(problem, best)
    if nothing is None or not nothing.evidence > polished[0].evidence:
        return problem, polished
    return replace(problem, slack_suffices=slack_does(problem, nothing)), [nothing, *polished[1:]]


def _nothing(problem: Problem, best: Judged) -> Judged | None:
    """No effect, fitted from where the best explanation is; None where that has none, or the log forbids it."""
    knobs = best.explanation.knobs
    return left_to_slack(problem, best, range(len(knobs)), LITTLE) if knobs else None


def _best(problem: Problem, polished: list[Judged]) -> Judged:
    none = polished[0].evidence
    pays = [j for j in polished[1:] if j.evidence > none + WORTH_AN_EFFECT and not is_minor(problem, j)]
    return max(pays, key=lambda judged: judged.evidence, default=polished[0])
