"""The disturbance that acts on a sound vehicle, as its flights show it."""

from collections.abc import Iterable, Sequence

import numpy as np

from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.identify.paths import Fit
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.motion.reduce import disturbance_precision, local_precision
from auv_torchrl.diagnosis.motion.smooth import Layout, noise_per_sample
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import PRIOR_NUMBERS
from auv_torchrl.flightlog import Finding, Severity
from auv_torchrl.vehicle import DEGREES_OF_FREEDOM

ROUNDS = 30


def disturbance_floor(flights: Sequence[tuple[Problem, Fit]]) -> Floats:
    """Standard deviation (D,) in N and N m of the force that acts on a sound vehicle.

    The size that makes the samples of all windows most likely (MacKay 1992, fixed point of the evidence). The stated
    floor counts as a few forces more, so that a log which determines none of them cannot claim a floor of zero.
    """
    problem, _ = flights[0]
    stated = np.array(problem.settings.floor_force)[problem.layout.dof]
    floor, each = stated.copy(), [_numbers(*flight) for flight in flights]
    for _ in range(ROUNDS):
        counted = [
            _counted(flight.layout, flight.windows.dt, floor, *told)
            for (flight, _), told in zip(flights, each, strict=True)
        ]
        squares, seen = np.sum(counted, axis=0)
        floor = np.sqrt((squares + PRIOR_NUMBERS * stated**2) / (seen + PRIOR_NUMBERS))
    return floor


def _counted(
    layout: Layout, dt: float, floor: Floats, gram: Floats, pull: Floats, away: Floats
) -> tuple[Floats, Floats]:
    """Of one flight under a floor (D,): squares (D,) of the forces that its samples show, and how many these are.

    A flight that moves faster than another has shorter bins, and more of them.
    """
    count, starts, (bins, dofs) = len(gram), len(layout.start), (layout.bins, len(layout.dof))
    unit = disturbance_precision(layout, dt, np.ones(1))  # (B, B)
    precision = local_precision(layout, dt, floor)
    covariance = np.linalg.inv(gram + precision)
    mean = away + np.einsum("wlm,wm->wl", covariance, pull - away @ precision)
    force = mean[:, starts:].reshape(count, bins, dofs)
    spread = covariance[:, starts:, starts:].reshape(count, bins, dofs, bins, dofs)
    squares: Floats = np.einsum("wbd,bc,wcd->d", force, unit, force)
    return squares, count * bins - np.einsum("bc,wbdcd->d", unit, spread) / floor**2


def _numbers(problem: Problem, fit: Fit) -> tuple[Floats, Floats, Floats]:
    """Of the windows that are followed: curvature (w, L, L) and slope (w, L) in the free numbers, and these (w, L)."""
    windows, state = problem.windows, fit.path.state
    used = np.isfinite(state.slope).all((1, 2)) & np.isfinite(state.residual).all(1) & problem.followed
    weight = 1.0 / noise_per_sample(windows, problem.sigma)
    slope, residual = state.slope[used] * weight[:, None], state.residual[used] * weight
    away = problem.layout.away(windows, state.start, state.bins)[used]
    return slope.swapaxes(1, 2) @ slope, np.einsum("wkl,wk->wl", slope, residual), away


def stated_floor(settings: Settings, dof: np.ndarray) -> Finding:
    """What the verdict rests on where there is no healthy log."""
    sentence = (
        "no healthy log: the verdict rests on an assumed disturbance of "
        f"{sizes_by_axis(np.array(settings.floor_force), dof)} and on coefficients within a few per cent"
    )
    remedy = "Give healthy=LOG, a flight of the sound vehicle, to measure both"
    return Finding(Severity.INFO, "floor_assumed", sentence, remedy)


def shown_floor(problem: Problem) -> tuple[Finding, ...]:
    """What effects stand out of, where that is what the log leaves of a file that was corrected on it."""
    if problem.known is None or not problem.known.of_itself:
        return ()
    sizes = sizes_by_axis(problem.known.floor, problem.layout.dof)
    sentence = (
        f"effects are looked for beside a disturbance of {sizes}, which is what this log leaves of the corrected file: "
        "smaller ones cannot be seen"
    )
    return (Finding(Severity.INFO, "floor_of_this_log", sentence),)


def sizes_by_axis(floor: Floats, dof: Iterable[int]) -> str:
    """Sizes of a disturbance (6,) in N and N m, of the degrees of freedom ``dof``, in words."""
    return ", ".join(f"{floor[d]:.2g} {'N' if d < 3 else 'N m'} in {DEGREES_OF_FREEDOM[d]}" for d in dof)
