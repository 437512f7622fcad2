"""Values along which chi-square is rough or a narrow valley, so that slopes mislead: those near by are tried."""

from collections.abc import Mapping

import numpy as np

from auv_torchrl.diagnosis.identify.assess import (
    assess,
    joint_precision,
    moved_along,
    take_step,
    term_changes,
    value_steps,
)
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.following import nudge, nudged_chi2
from auv_torchrl.diagnosis.identify.hypotheses import declared
from auv_torchrl.diagnosis.identify.paths import Fit, leaves_much, nuisance_now, quadratic
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import (
    NUISANCE_NEAR,
    NUISANCE_REACH,
    SETTLED_TRIALS,
    THRESHOLD_REACH,
    TRIED_STEPS,
    WALKS,
)
from auv_torchrl.effects import EFFECTS
from auv_torchrl.effects.trial import Valley
from auv_torchrl.sysid.bounded import minimum_within


def moved_by(problem: Problem, explanation: Explanation, moves: Mapping[tuple[str, str], float]) -> Explanation:
    """The explanation with some numbers, by effect and parameter, moved within their bounds."""
    amounts, nuisance = {}, dict(explanation.nuisance)
    for place, term in enumerate(explanation.terms):
        by = moves.get((term.effect, term.members[0])) if len(term.members) == 1 else None
        if by is not None:
            p = declared(term.effect, problem.vehicle).parameters[term.members[0]]
            amounts[place] = min(max(term.value + by, p.low), p.high)
    have_value = {term.key for term in explanation.terms}
    low, high = problem.nuisance_bounds
    for (effect, member, _, _), least, most in zip(problem.nuisance, low.tolist(), high.tolist(), strict=True):
        if (effect, member) in moves and (effect, (member,)) not in have_value:
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
    changes = [*term_changes(problem, fit.explanation)[0], moved_by(problem, fit.explanation, moves)]
    q = quadratic(problem, fit.path, changes, nuisance_responses=fit.nuisance_responses)
    mine = [entry[:2] for entry in problem.nuisance]
    mine += [(term.effect, term.members[0]) if len(term.members) == 1 else None for term in fit.explanation.fitted]
    free = np.array([member not in moves for member in mine])
    stiffness, least, most = value_steps(problem, fit.explanation, fit.steps)
    H = q.A[:-1, :-1] + joint_precision(problem.nuisance_precision, stiffness)
    trials = []
    for step in steps.tolist():
        there = moved_by(problem, fit.explanation, valley.moves(fit.path.vehicle, step))
        at = nuisance_now(problem, there)
        toward = np.concatenate([-problem.nuisance_precision @ at, np.zeros(len(fit.steps))])
        low, high = problem.nuisance_bounds
        bounds = np.concatenate([low - at, least]), np.concatenate([high - at, most])
        by = minimum_within(H, q.b[:-1] - step / unit * q.A[:-1, -1] + toward, bounds, np.zeros(len(free)), free)
        trials.append(take_step(problem, there, by[k:] * fit.steps, by[:k]))
    return trials


def search_thresholds(problem: Problem, best: Fit) -> Fit:
    """Try values near by for effects that switch single samples, because there chi-square is rough.

    The smooth numbers go along with each. Nuisance parameters of thresholds is tried too, however well the log is
    explained: fits that end at different ones are apart by more than an effect is worth.
    """
    if not np.isfinite(best.chi2):
        return best
    for order, term in enumerate(best.explanation.fitted):
        if problem.settings.is_rough(term.effect):
            for reach in THRESHOLD_REACH:
                width = reach * problem.prior.width(term.effect, term.members[0])
                best = _best_along(problem, best, [{len(problem.nuisance) + order: width * u} for u in TRIED_STEPS])
    for column, (effect, _, _, width) in enumerate(problem.nuisance):
        if problem.settings.is_rough(effect):
            now = nuisance_now(problem, best.explanation)[column]
            best = _best_along(problem, best, [{column: NUISANCE_REACH * width * u - now} for u in TRIED_STEPS])
            best = _best_along(problem, best, [{column: NUISANCE_NEAR * width * u} for u in TRIED_STEPS])
    for name, effect in EFFECTS.items():
        valley = effect.trial.valley
        if valley is not None and (not leaves_much(problem, best) or valley.beside[0] in best.explanation.effects):
            best = _search_valley(problem, best, name, valley)
    return best


def _search_valley(problem: Problem, best: Fit, effect: str, valley: Valley) -> Fit:
    """Try values near by of a number, with others moved so that the vehicle does about the same."""
    there = {(name, (member,)) for name, member, _, _ in problem.nuisance} | {k.key for k in best.explanation.fitted}
    name, member = valley.beside
    if not {(effect, (valley.leading,)), (name, (member,))} <= there:
        return best
    for _ in range(WALKS):
        before = best
        for reach in THRESHOLD_REACH[1:]:
            steps = reach * problem.prior.width(effect, valley.leading) * TRIED_STEPS
            best = _best_of(problem, best, walks(problem, best, valley, steps))
        if best is before:
            break
    return best


def _best_along(problem: Problem, best: Fit, amounts: list[dict[int, float]]) -> Fit:
    """The best of an explanation and of those with some numbers moved by amounts, alone or the others along."""
    return _best_of(problem, best, [moved_along(problem, best, some, on) for on in (True, False) for some in amounts])


def _best_of(problem: Problem, best: Fit, trials: list[Explanation]) -> Fit:
    """The best of an explanation and of some that differ a little from it.

    Chi-square says to second order what it would be once starts and disturbance have settled: few need to settle.
    """
    foretold = nudged_chi2(problem, trials, best.path, steps=0)
    likely = [trials[row] for row in foretold.argsort()[:SETTLED_TRIALS]]
    chi2 = nudged_chi2(problem, likely, best.path)
    if not chi2.min() < best.chi2 - 0.1:
        return best
    return assess(problem, nudge(problem, likely[int(chi2.argmin())], best.path), before=best)[0]
