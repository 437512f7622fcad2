"""The two ways to fit the values of an explanation.

Along the measured motion effects are nearly linear, and nothing is simulated. By simulation values, nuisance
parameters, the starts and the disturbance are fitted until nothing moves.
"""

from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.identify.assess import assess, even_step, take_step
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.following import (
    chi2_by_window,
    nudge,
    path_under,
    settle_state,
    some_diverged,
)
from auv_torchrl.diagnosis.identify.paths import Fit, WindowPath, leaves_much, nuisance_now
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.rough_values import search_thresholds
from auv_torchrl.diagnosis.motion.noise import sensor_noise
from auv_torchrl.diagnosis.thresholds import (
    FITTED_ON,
    GAINS_AGAIN,
    NOISE_MATTERS,
    RELINEARISED,
    SETTLED_ALONG,
    STILL_GAINS,
    STUCK_ALONG,
)

STEPS_ALONG = 6  # at most


def fit_by_simulation(
    problem: Problem, explanation: Explanation, start: WindowPath, rounds: int = 4, enough: float = np.inf
) -> Fit:
    """Fit all values of an explanation by simulating it, and weigh it.

    One that is still beyond a chi-square of ``enough`` when it was linearised again once is left at that.
    """
    best = _descend(problem, path_under(problem, explanation, start), rounds)
    if not rounds:
        return replace(best, nuisance_responses=None)
    searched = search_thresholds(problem, best)
    if searched is not best:
        best = _descend(problem, searched.path, rounds)
    # By a tilt or a speed that nobody measured, or by a motion that no force could follow.
    is_bent = problem.layout.moves_unseen or problem.layout.by_specific_force.any() or problem.hardly_followed
    for turn in range(RELINEARISED if is_bent else 0):
        if best.nothing_left or not np.isfinite(best.chi2) or (turn and best.chi2 > enough):
            break
        again = _descend(problem, path_under(problem, best.explanation, best.path), rounds)
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


def rescued(problem: Problem, fit: Fit, follow: WindowPath, enough: float = np.inf) -> Fit:
    """An explanation that leaves much, fitted again from what it does along the measured motion ``follow``.

    Healthy flights make the disturbance that may act so small that a window in which the vehicle tilts elsewhere than
    it seems can be lost, and with it the way of all the others.
    """
    if problem.known is None or not problem.layout.moves_unseen or not leaves_much(problem, fit):
        return fit
    begin = fit_along_motion(problem, replace(fit.explanation, nuisance={}), follow)
    again = fit_by_simulation(problem, begin.explanation, follow, enough=enough)
    return min(fit, again, key=lambda one: one.chi2)


def _descend(problem: Problem, path: WindowPath, rounds: int) -> Fit:
    """Gauss-Newton with a shrinking stride.

    Where a step fails, the nuisance parameters of thresholds stays from there on. Where the first one does because
    single windows diverge, they begin anew behind it.
    """
    best, *step = assess(problem, path)
    stride, even = 1.0, bool(problem.even.all())
    for turn in range(rounds):
        if not np.isfinite(best.chi2):
            break
        terms, nuisance = even_step(problem, best) if even else step
        moved = take_step(problem, best.explanation, stride * terms, stride * nuisance)
        there, before = nudge(problem, moved, best.path), best
        if turn == 0 and not _chi2(problem, there) <= best.chi2 and some_diverged(problem, best.path, there):
            there, before = path_under(problem, moved, best.path), None
        if not _chi2(problem, there) <= best.chi2 + 0.1:  # NaN where it diverges
            stride, even = (0.3 * stride if even else stride), True
            continue
        trial, *trial_step = assess(problem, there, before=before)
        settled = best.chi2 - trial.chi2 < 0.5
        best, step = trial, trial_step
        if settled:
            break
    return best


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
