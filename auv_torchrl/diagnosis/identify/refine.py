"""Refine the best explanation: add effects while the log pays."""

from collections.abc import Callable

from auv_torchrl.diagnosis.identify.fit import fit_by_simulation
from auv_torchrl.diagnosis.identify.judged import Judged, leaves_much, spread, strained
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.screen import Field
from auv_torchrl.diagnosis.identify.small import is_minor
from auv_torchrl.diagnosis.thresholds import (
    CLOSES,
    FURTHER_TRIED,
    MOST_EFFECTS,
    WITHIN,
    WORTH_AN_EFFECT,
)

Progress = Callable[[str, float], None]


def explains(problem: Problem, judged: Judged) -> bool:
    """Whether an explanation leaves little, and not because slack makes up for what it lacks."""
    return not leaves_much(problem, judged) and not strained(problem, judged)


def from_another(problem: Problem, judged: Judged, other: Judged) -> Judged:
    """An explanation, or its fit from the slack and shared values of another where that is better: it may be stuck."""
    trial = fit_by_simulation(problem, judged.explanation.starting_from(other.explanation), other.base)
    return trial if trial.evidence > judged.evidence else judged


def _is_done(problem: Problem, judged: Judged) -> bool:
    """Whether an explanation leaves nothing, with slack that is likely."""
    return judged.nothing_left and not strained(problem, judged)


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

    Further values of effects that are there are tried whatever else promises more: they are no further effect. What
    slack is stretched for is tried whatever a sketch promises, in which slack keeps what it has of it.
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
        stretched = strained(problem, best) - best.explanation.members
        by_stretch = [s for s, new in added if not new & twins_of and s.explanation.members & stretched]
        trials += [s for s in by_stretch if s not in trials]
        fresh = [fit_by_simulation(problem, s.explanation, best.base) for s in trials]
        polished += fresh
        better = max((j for j in fresh if not is_minor(problem, j)), key=lambda judged: judged.evidence, default=best)
        if better.evidence <= best.evidence + WORTH_AN_EFFECT or best.chi2 - better.chi2 < closes:
            return best
        best = better
        if not is_worth_a_look(problem, best):
            return best
    return best
