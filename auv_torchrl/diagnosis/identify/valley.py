"""Steps along a valley: numbers that a log hardly tells apart where they move together."""

from collections.abc import Mapping

import numpy as np

from auv_torchrl.diagnosis.identify.assess import joint_precision, take_step, term_changes, value_steps
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.hypotheses import batch, declared
from auv_torchrl.diagnosis.identify.paths import Fit, nuisance_now, quadratic
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.effects.trial import Valley
from auv_torchrl.sysid.bounded import minimum_within


def moved_in_valley(problem: Problem, explanation: Explanation, valley: Valley, step: float) -> Explanation:
    """The explanation a step of the leading number further, the numbers that it has beside moved with it."""
    vehicle = batch(problem.vehicle, [explanation.values(problem.vehicle)])
    return _moved(problem, explanation, valley.moves(vehicle, step))


def _moved(problem: Problem, explanation: Explanation, moves: Mapping[tuple[str, str], float]) -> Explanation:
    """The explanation with some numbers, by effect and parameter, moved within their bounds."""
    amounts, nuisance = {}, dict(explanation.nuisance)
    for place, term in enumerate(explanation.terms):
        by = moves.get((term.effect, term.members[0])) if len(term.members) == 1 else None
        if by is not None:
            p = declared(term.effect, problem.vehicle).parameters[term.members[0]]
            amounts[place] = min(max(term.value + by, p.low), p.high)
    told = {term.key for term in explanation.terms}
    low, high = problem.nuisance_bounds
    for (effect, member, _, _), least, most in zip(problem.nuisance, low.tolist(), high.tolist(), strict=True):
        if (effect, member) in moves and (effect, (member,)) not in told:
            by = nuisance.get((effect, member), 0.0) + moves[effect, member]
            nuisance[effect, member] = min(max(by, least), most)
    return Explanation(explanation.moved(amounts).terms, nuisance)


def walks(problem: Problem, fit: Fit, valley: Valley, steps: Floats) -> list[Explanation]:
    """The explanation some ``steps`` of the leading number further, all numbers beside the valley along as fits best.

    What the valley's numbers do together is one response, taken at the largest step. By itself each of them switches
    samples that together they do not, and the others would make up for what does not happen.
    """
    k, unit = len(problem.nuisance), float(np.abs(steps).max())
    moves = valley.moves(fit.path.vehicle, unit)
    changes = [*term_changes(problem, fit.explanation)[0], _moved(problem, fit.explanation, moves)]
    q = quadratic(problem, fit.path, changes, nuisance_responses=fit.nuisance_responses)
    mine = [entry[:2] for entry in problem.nuisance]
    mine += [(term.effect, term.members[0]) if len(term.members) == 1 else None for term in fit.explanation.fitted]
    free = np.array([member not in moves for member in mine])
    stiffness, least, most = value_steps(problem, fit.explanation, fit.steps)
    H = q.A[:-1, :-1] + joint_precision(problem.nuisance_precision, stiffness)
    trials = []
    for step in steps.tolist():
        there = _moved(problem, fit.explanation, valley.moves(fit.path.vehicle, step))
        at = nuisance_now(problem, there)
        toward = np.concatenate([-problem.nuisance_precision @ at, np.zeros(len(fit.steps))])
        low, high = problem.nuisance_bounds
        bounds = np.concatenate([low - at, least]), np.concatenate([high - at, most])
        by = minimum_within(H, q.b[:-1] - step / unit * q.A[:-1, -1] + toward, bounds, np.zeros(len(free)), free)
        trials.append(take_step(problem, there, by[k:] * fit.steps, by[:k]))
    return trials
