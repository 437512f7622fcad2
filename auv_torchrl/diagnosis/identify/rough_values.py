"""Values along which chi-square is rough or a narrow valley, so that slopes mislead: those near by are tried."""

import numpy as np

from auv_torchrl.diagnosis.identify.assess import assess, moved_along
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.following import nudge, nudged_chi2
from auv_torchrl.diagnosis.identify.paths import Fit, leaves_much, nuisance_now
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.valley import walks
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
