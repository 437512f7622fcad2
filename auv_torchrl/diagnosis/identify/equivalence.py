"""What this log cannot tell apart: changes that leave the same response on it.

Most frames look the same from the front and from behind. Where a log does not tell the two apart, thrusters that are
exchanged at one end under a sound compass are the same as others at the other end under one that points backwards.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.identify.explanation import Explanation, Term
from auv_torchrl.diagnosis.identify.hypotheses import Candidate, batch, declared
from auv_torchrl.diagnosis.identify.paths import quadratic, without_nuisance
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.screen import Field
from auv_torchrl.diagnosis.identify.search import Found
from auv_torchrl.diagnosis.thresholds import NOT_EXCLUDED, SAME_RESPONSE
from auv_torchrl.physics import prepare
from auv_torchrl.sensors import Inverse


def indistinguishable(problem: Problem, found: Found) -> tuple[tuple[str, ...], ...]:
    """Sets of effects, or of parameters of one effect, of which the log cannot tell which one acts.

    They come from three sides: explanations that fit as well as the best one, changes whose response is the same, and
    thrusters that are exchanged on a vehicle turned round.
    """
    same_responses = [(mine, theirs) for mine, theirs, _ in alternatives(problem, found)]
    sets = {frozenset(pair) for pair in [*_rivals(found), *same_responses, *turned_round(problem, found)]}
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


NEARLY = 0.1  # rad away from half a turn, in which a value of a scan or of a fit is taken for one


def turned_round(problem: Problem, found: Found) -> list[tuple[str, str]]:
    """Exchanged thrusters of the best explanation, and what has the same response with the heading turned round."""
    best = found.best.explanation
    exchanged = [term for term in best.terms if term.discrete]
    if not exchanged:
        return []
    turned = [
        term for term in best.terms if not term.discrete and _angle(problem, Explanation((term,))) > np.pi - NEARLY
    ]
    rest = replace(best, terms=tuple(term for term in best.terms if term not in (*exchanged, *turned)))
    turns = [([], rest)] if turned else _half_turns(problem, rest)
    others = [
        (
            " with ".join([*turn, _exchange(candidate.effect, candidate.values)]),
            around.with_candidate(candidate, problem.vehicle),
        )
        for turn, around in turns
        for candidate in problem.candidates
        if candidate.discrete
    ]
    if not others:
        return []
    own = _exchange(exchanged[0].effect, [term.members[0] for term in exchanged])
    mine = " with ".join([*(term.effect for term in turned), own])
    same = _same_response(problem, found, [best, *(other for _, other in others)])
    return [(mine, name) for (name, _), is_same in zip(others, same, strict=True) if is_same]


def _half_turns(problem: Problem, rest: Explanation) -> list[tuple[list[str], Explanation]]:
    """``rest`` with the heading turned round, by each change of a sensor that can do so."""
    found = []
    for candidate in problem.candidates:
        angle = 0.0 if candidate.discrete else _angle(problem, Explanation().with_candidate(candidate, problem.vehicle))
        if angle > np.pi - NEARLY:
            found.append(([candidate.effect], rest.with_candidate(candidate, problem.vehicle, np.pi / angle)))
    return found


def _angle(problem: Problem, explanation: Explanation) -> float:
    """Angle in rad between the reported and the true heading under an explanation."""
    c = prepare(batch(problem.vehicle, [explanation.values(problem.vehicle)])).numpy()
    return float(2 * np.arccos(np.clip(np.abs(Inverse.of(c, problem.windows.channels).turn[0, 0]), 0.0, 1.0)))


def _same_response(problem: Problem, found: Found, explanations: list[Explanation]) -> np.ndarray:
    """Whether each explanation but the first leaves the response of the first one (N - 1,)."""
    q = quadratic(problem, found.follow, explanations, chosen=problem.followed)
    _, A = without_nuisance(problem, q, found.follow.explanation)
    size = np.sqrt(np.maximum(np.diag(A), 1e-300))
    return A[0, 1:] > SAME_RESPONSE * size[0] * size[1:]


def _exchange(effect: str, members: Iterable[str]) -> str:
    """The effect and the thrusters that it exchanges, e.g. ``thruster_swap 1 4``."""
    return " ".join([effect, *sorted((member.rsplit("_", 1)[1] for member in members), key=int)])
