"""The two ways to fit the values of an explanation, and values near by that are tried where slopes mislead.

Along the measured motion effects are nearly linear, and nothing is simulated. By simulation values, nuisance
parameters, the starts and the disturbance are fitted until nothing moves. Where chi-square is rough or a narrow valley
in a value, values near by are tried.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.identify.assess import (
    assess,
    even_step,
    joint_precision,
    moved_along,
    take_step,
    term_changes,
    value_steps,
)
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.following import (
    chi2_by_window,
    nudge,
    nudged_chi2,
    path_under,
    settle_state,
    some_diverged,
)
from auv_torchrl.diagnosis.identify.hypotheses import declared
from auv_torchrl.diagnosis.identify.paths import Fit, WindowPath, leaves_much, nuisance_now, quadratic
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.motion.noise import sensor_noise
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import (
    FITTED_ON,
    GAINS_AGAIN,
    NOISE_MATTERS,
    NUISANCE_NEAR,
    NUISANCE_REACH,
    RELINEARISED,
    SETTLED_ALONG,
    SETTLED_TRIALS,
    STILL_GAINS,
    STUCK_ALONG,
    THRESHOLD_REACH,
    TRIED_STEPS,
    WALKS,
)
from auv_torchrl.effects import EFFECTS
from auv_torchrl.effects.trial import Valley
from auv_torchrl.sysid.bounded import minimum_within

STEPS_ALONG = 6  # of a fit along the motion, at most


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

    The smooth numbers go along with each. Nuisance parameters of thresholds are tried too, however well the log is
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


def fit_by_simulation(
    problem: Problem, explanation: Explanation, start: WindowPath, rounds: int = 4, enough: float = np.inf
) -> Fit:
    """Fit all values of an explanation by simulating it, and weigh it.

    One that is still beyond a chi-square of ``enough`` when it was linearised again once is left at that.
    """
    best, gains = _descend(problem, path_under(problem, explanation, start), rounds)
    if not rounds:
        return replace(best, nuisance_responses=None)
    searched = search_thresholds(problem, best)
    if searched is not best:
        best, gains = _descend(problem, searched.path, rounds)
    is_bent = problem.layout.moves_unseen or problem.layout.by_specific_force.any()  # tilts or speeds nobody measured
    for turn in range(RELINEARISED if is_bent or gains else 0):
        if best.nothing_left or not np.isfinite(best.chi2) or (turn and best.chi2 > enough):
            break
        again, _ = _descend(problem, path_under(problem, best.explanation, best.path), rounds)
        if not again.chi2 < best.chi2:
            break
        settled = best.chi2 - again.chi2 <= GAINS_AGAIN * again.chi2
        best = again
        if settled:
            break
    return replace(best, nuisance_responses=None)


def fit_along_motion(problem: Problem, explanation: Explanation, follow: WindowPath, enough: float = np.inf) -> Fit:
    """Fit all values of an explanation along the measured motion, and weigh it: a quick look before polishing.

    Its forces are exact there, however wrong a simulation that lacks some other effect would go. One that would not
    come below a chi-square of ``enough`` by twice what its last step gained is left where it is.
    """
    best, step, nuisance_step = assess(problem, follow, explanation)
    stride = 1.0
    for _ in range(STEPS_ALONG):
        moved = take_step(problem, best.explanation, stride * step, stride * nuisance_step)
        trial, trial_step, trial_nuisance_step = assess(problem, follow, moved, best)
        gained = best.chi2 - trial.chi2
        if not gained > 0 and abs(gained) <= STUCK_ALONG * best.chi2:  # as at a bound: a shorter step brings no more
            break
        if not gained > 0:
            stride *= 0.3
            continue
        best, step, nuisance_step = trial, trial_step, trial_nuisance_step
        if gained < SETTLED_ALONG * trial.chi2 or best.chi2 - 2 * gained > enough:
            break
    return replace(best, nuisance_responses=None)


def fitted_on(problem: Problem, fit: Fit) -> Fit:
    """An explanation fitted on while that gains something, in units of what it leaves anyway."""
    for _ in range(FITTED_ON):
        further = fit_by_simulation(problem, fit.explanation, fit.path)
        if not further.evidence > fit.evidence + STILL_GAINS * max(1.0, fit.excess):
            break
        fit = further
    return fit


def _descend(problem: Problem, path: WindowPath, rounds: int) -> tuple[Fit, bool]:
    """Gauss-Newton with a shrinking stride, and whether its last round still gained much.

    Where a step fails, the nuisance parameters of thresholds stay from there on. Where the first one does because
    single windows diverge, they begin anew behind it.
    """
    best, *step = assess(problem, path)
    stride, even, gains = 1.0, bool(problem.even.all()), False
    for turn in range(rounds):
        if not np.isfinite(best.chi2):
            break
        terms, nuisance = even_step(problem, best) if even else step
        moved = take_step(problem, best.explanation, stride * terms, stride * nuisance)
        there, before = nudge(problem, moved, best.path), best
        if turn == 0 and not _chi2(problem, there) <= best.chi2 and some_diverged(problem, best.path, there):
            there, before = path_under(problem, moved, best.path), None
        if not _chi2(problem, there) <= best.chi2 + 0.1:  # NaN where it diverges
            stride, even, gains = (0.3 * stride if even else stride), True, False
            continue
        trial, *trial_step = assess(problem, there, before=before)
        gained = best.chi2 - trial.chi2
        best, step, gains = trial, trial_step, gained > GAINS_AGAIN * trial.chi2
        if gained < 0.5:
            break
    return best, gains


def _chi2(problem: Problem, path: WindowPath) -> float:
    """Chi-square by which :func:`assess` weighs the explanation of a path, without the responses: these take long."""
    nuisance = nuisance_now(problem, path.explanation)
    return float(chi2_by_window(problem, path.state).sum() + nuisance @ problem.nuisance_precision @ nuisance)


def measure_noise(problem: Problem, fit: Fit) -> Problem:
    """The problem with the sensor noise measured again under a better vehicle; the same where that is no other."""
    if problem.windows.whitening is not None:  # it was made for this noise
        return problem
    state = fit.path.state
    free, _ = settle_state(problem, fit.path.vehicle, state, problem.freedom(state, problem.wide))
    measured = sensor_noise(problem.windows, free, problem.sigma, problem.wide)
    if len(measured) < len(problem.sigma):  # too few samples for a free force: the disturbance leaves more of them
        measured = sensor_noise(problem.windows, state, problem.sigma, problem.floor) | measured
    least = {n: min(measured.get(n, size), problem.rough_noise[n]) for n, size in problem.sigma.items()}
    sigma = problem.believed(least)
    changed = any(abs(sigma[name] / problem.sigma[name] - 1) > NOISE_MATTERS for name in sigma)
    return replace(problem, sigma=sigma) if changed else problem


def reassess(problem: Problem, fit: Fit) -> Fit:
    """Weigh an explanation again, after the noise was measured anew."""
    path = nudge(problem, fit.explanation, fit.path)
    if some_diverged(problem, fit.path, path):
        path = path_under(problem, fit.explanation, fit.path)
    return replace(assess(problem, path)[0], nuisance_responses=None)
