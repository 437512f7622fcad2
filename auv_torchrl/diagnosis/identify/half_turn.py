"""A vehicle seen turned round: with the heading off by half a turn, other thrusters seem exchanged.

Most frames look the same from the front and from behind. Where a log does not tell the two apart, thrusters that are
exchanged at one end under a sound compass are the same as others at the other end under one that points backwards.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.found import Found
from auv_torchrl.diagnosis.identify.hypotheses import batch
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.quadratics import quadratic, without_nuisance
from auv_torchrl.diagnosis.thresholds import SAME_RESPONSE
from auv_torchrl.physics import prepare
from auv_torchrl.sensors import Inverse

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
    same = _same_mark(problem, found, [best, *(other for _, other in others)])
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


def _same_mark(problem: Problem, found: Found, explanations: list[Explanation]) -> np.ndarray:
    """Whether each explanation but the first leaves the response of the first one (N - 1,)."""
    q = quadratic(problem, found.follow, explanations, chosen=problem.followed)
    _, A = without_nuisance(problem, q, found.follow.explanation)
    size = np.sqrt(np.maximum(np.diag(A), 1e-300))
    return A[0, 1:] > SAME_RESPONSE * size[0] * size[1:]


def _exchange(effect: str, members: Iterable[str]) -> str:
    """The effect and the thrusters that it exchanges, e.g. ``thruster_swap 1 4``."""
    return " ".join([effect, *sorted((member.rsplit("_", 1)[1] for member in members), key=int)])
