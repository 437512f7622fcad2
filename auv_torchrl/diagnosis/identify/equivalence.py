"""What this log cannot tell apart: changes that leave the same response on it."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.identify.declared import declared
from auv_torchrl.diagnosis.identify.explanation import Explanation, Term
from auv_torchrl.diagnosis.identify.found import Found
from auv_torchrl.diagnosis.identify.half_turn import turned_round
from auv_torchrl.diagnosis.identify.hypotheses import Candidate
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.screen import Field
from auv_torchrl.diagnosis.thresholds import NOT_EXCLUDED, SAME_RESPONSE


def indistinguishable(problem: Problem, found: Found) -> tuple[tuple[str, ...], ...]:
    """Sets of effects, or of parameters of one effect, of which the log cannot tell which one acts.

    They come from three sides: explanations that fit as well as the best one, changes whose response is the same, and
    thrusters that are exchanged on a vehicle turned round.
    """
    same_marks = [(mine, theirs) for mine, theirs, _ in alternatives(problem, found)]
    sets = {frozenset(pair) for pair in [*_rivals(found), *same_marks, *turned_round(problem, found)]}
    return tuple(sorted(tuple(sorted(names)) for names in sets))


def _rivals(found: Found) -> list[tuple[str, str]]:
    best = set(found.best.explanation.effects)
    pairs = []
    for fit in found.fits:
        other = set(fit.explanation.effects)
        mine, theirs = best - other, other - best
        if len(mine) == len(theirs) == 1 and fit.chi2 < found.best.chi2 + NOT_EXCLUDED:
            pairs.append((mine.pop(), theirs.pop()))
    return pairs


def alternatives(problem: Problem, found: Found) -> list[tuple[str, str, Explanation]]:
    """What of the best explanation something else with the same response could do, and the explanation with that."""
    best = found.best.explanation
    others = []
    for one, other, ratio in _same_candidates(problem, found.field):
        for mine, theirs, scale in ((one, other, ratio), (other, one, 1 / ratio)):
            if _acts(mine, best):
                terms = [k for k in best.terms if k.effect == mine.effect and set(k.members) <= set(mine.values)]
                rest = replace(best, terms=tuple(k for k in best.terms if k not in terms))
                amount = 1.0 if mine.discrete else scale * _amount(mine, terms[0], problem)
                others.append(
                    (_name(mine, theirs), _name(theirs, mine), rest.with_candidate(theirs, problem.vehicle, amount))
                )
    return others


def _same_candidates(problem: Problem, field: Field) -> Iterator[tuple[Candidate, Candidate, float]]:
    """Pairs of candidates with the same response, and how much of the second one is as large as the first."""
    size = np.sqrt(np.maximum(np.diag(field.A), 0.0))
    rows = np.flatnonzero(field.seen)
    cosine = field.A[np.ix_(rows, rows)] / np.outer(size[rows], size[rows])
    for a, b in zip(*np.nonzero(np.abs(np.triu(cosine, 1)) > SAME_RESPONSE), strict=True):
        one, other = problem.candidates[rows[a]], problem.candidates[rows[b]]
        if _name(one, other) != _name(other, one):
            yield one, other, float(np.sign(cosine[a, b]) * size[rows[a]] / size[rows[b]])


def _amount(candidate: Candidate, term: Term, problem: Problem) -> float:
    """How many candidates a fitted value is."""
    nominal = declared(candidate.effect, problem.vehicle).nominal[term.members[0]]
    return (term.value - nominal) / (candidate.values[term.members[0]] - nominal)


def _name(candidate: Candidate, other: Candidate) -> str:
    """The effect, or its parameters where the two are of the same effect."""
    return candidate.effect if candidate.effect != other.effect else ", ".join(candidate.values)


def _acts(candidate: Candidate, explanation: Explanation) -> bool:
    """Whether the explanation has all that the candidate changes, and of a swap nothing else."""
    terms = [term for term in explanation.terms if term.effect == candidate.effect]
    if candidate.discrete:
        return bool(terms) and {(k.members[0], k.value) for k in terms} == set(candidate.values.items())
    return any(set(term.members) <= set(candidate.values) for term in terms)
