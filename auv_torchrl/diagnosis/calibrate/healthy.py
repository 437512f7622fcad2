"""What a log of the sound vehicle says before its fault is looked for: its own coefficients, disturbance and noise."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.fit import fit_by_simulation, measure_noise, reassess
from auv_torchrl.diagnosis.identify.following import follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import Settings, apply_values
from auv_torchrl.diagnosis.identify.judged import Judged
from auv_torchrl.diagnosis.identify.problem import Known, Problem
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.motion.reduce import OU_TIME, disturbance_precision, local_precision
from auv_torchrl.diagnosis.motion.smooth import noise_per_sample
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import PRIOR_NUMBERS, REPEATS
from auv_torchrl.flightlog import Finding, FlightLog, Severity, join
from auv_torchrl.vehicle import DEGREES_OF_FREEDOM, Vehicle

ROUNDS = 30
PASSES = 2  # slack and floor in turn


@dataclass(frozen=True)
class Calibration:
    """The vehicle as the healthy log shows it."""

    vehicle: Vehicle  # empty batch, slack included
    known: Known
    slack: dict[tuple[str, str], float]  # deviations from the vehicle as it was given
    findings: tuple[Finding, ...]
    has_gap: bool  # beyond slack, under the floor of the settings


def calibrate(healthy: Sequence[FlightLog], vehicle: Vehicle, settings: Settings) -> Calibration:
    """Fit the slack of a sound vehicle, then its disturbance floor, each under the other.

    Args:
        healthy: at least one log without the fault.
        vehicle: nominal, empty batch; roll and pitch held or free as they are to be diagnosed.
        settings: widths of the slack and the floor to begin from.
    """
    log = join(healthy)
    problem = Problem.of(cut_windows(log, settings.window_s, settings.lead_s, settings.bin_s), vehicle, settings)
    problem, follow = follow_windows(problem)
    judged = fit_by_simulation(problem, Explanation(), follow)
    if (anew := measure_noise(problem, judged)) is not problem:
        problem, judged = anew, reassess(anew, judged)
    excess = judged.chi2 / judged.quadratic.numbers  # under the stated floor
    for _ in range(PASSES):
        problem = replace(problem, floor=disturbance_floor(problem, judged))
        judged = fit_by_simulation(problem, judged.explanation, judged.base)
    slack = judged.explanation.slack
    floor = np.array(settings.floor_force)
    floor[problem.layout.dof] = problem.floor
    k = len(problem.slack)
    nominal = np.array([value for _, _, value, _ in problem.slack])
    covariance = np.linalg.inv(judged.quadratic.A[:k, :k] + problem.slack_precision) + np.diag((REPEATS * nominal) ** 2)
    own = apply_values(vehicle, Explanation(slack=slack).values(vehicle))
    known = Known(floor, problem.sigma, problem.rough_noise, covariance)
    findings = tuple(_findings(log, problem, slack, excess, settings))
    return Calibration(own, known, slack, findings, excess > settings.excess)


def disturbance_floor(problem: Problem, judged: Judged) -> Floats:
    """Standard deviation (D,) in N and N m of the force that acts on a sound vehicle.

    The size that makes the samples of all windows most likely (MacKay 1992, fixed point of the evidence). The stated
    floor counts as a few forces more, so that a log which determines none of them cannot claim a floor of zero.
    """
    layout, windows, state = problem.layout, problem.windows, judged.base.state
    used = np.isfinite(state.slope).all((1, 2)) & np.isfinite(state.residual).all(1) & problem.followed
    weight = 1.0 / noise_per_sample(windows, problem.sigma)
    slope, residual = state.slope[used] * weight[:, None], state.residual[used] * weight
    away = np.concatenate([(state.start - windows.guess)[:, layout.start], state.bins.reshape(len(windows), -1)], 1)
    away, count = away[used], int(used.sum())
    gram, pull = slope.swapaxes(1, 2) @ slope, np.einsum("wkl,wk->wl", slope, residual)
    starts, (bins, dofs) = len(layout.start), (layout.bins, len(layout.dof))
    unit = disturbance_precision(layout, windows.dt, np.ones(1))  # (B, B)
    stated = np.array(problem.settings.floor_force)[layout.dof]
    floor = stated.copy()
    for _ in range(ROUNDS):
        precision = local_precision(layout, windows.dt, floor)
        covariance = np.linalg.inv(gram + precision)
        mean = away + np.einsum("wlm,wm->wl", covariance, pull - away @ precision)
        force = mean[:, starts:].reshape(count, bins, dofs)
        spread = covariance[:, starts:, starts:].reshape(count, bins, dofs, bins, dofs)
        squares = np.einsum("wbd,bc,wcd->d", force, unit, force)
        seen = count * bins - np.einsum("bc,wbdcd->d", unit, spread) / floor**2  # numbers that the samples determine
        floor = np.sqrt((squares + PRIOR_NUMBERS * stated**2) / (seen + PRIOR_NUMBERS))
    return floor


def noise_findings(noisier: dict[str, float]) -> tuple[Finding, ...]:
    """A warning about channels that are so many times noisier than on the healthy log."""
    if not noisier:
        return ()
    sizes = ", ".join(f"{name} {times:.1f} times" for name, times in noisier.items())
    sentence = f"the sensors are noisier than on the healthy log: {sizes}; their noise is fitted on this log instead"
    return (Finding(Severity.WARNING, "noisier_than_healthy", sentence, columns=tuple(noisier)),)


def stated_floor(settings: Settings, dof: np.ndarray) -> Finding:
    """What the verdict rests on where there is no healthy log."""
    sentence = (
        f"no healthy log: the verdict rests on an assumed disturbance of {_sizes(np.array(settings.floor_force), dof)} "
        "and on coefficients within a few per cent"
    )
    remedy = "Give healthy=LOG, a flight of the sound vehicle, to measure both"
    return Finding(Severity.INFO, "floor_assumed", sentence, remedy)


def _findings(
    log: FlightLog, problem: Problem, slack: dict[tuple[str, str], float], excess: float, settings: Settings
) -> list[Finding]:
    floor = np.array(settings.floor_force)
    floor[problem.layout.dof] = problem.floor
    most = max(slack, key=lambda key: abs(slack[key]) / _nominal(problem, key), default=None)
    largest = "" if most is None else f"; the largest correction is {' '.join(most)} {slack[most]:+.3f}"
    sentence = (
        f"the verdict rests on the healthy log {log.name} ({log.duration:.0f} s): disturbance of "
        f"{_sizes(floor, problem.layout.dof)} over {OU_TIME:g} s, coefficients calibrated on it{largest}"
    )
    found = [Finding(Severity.INFO, "floor_measured", sentence)]
    if excess > settings.excess:
        sentence = (
            f"the healthy log {log.name} departs from the simulator by more than slack (chi-square {excess:.2f} per "
            "number): what is left of it counts as disturbance, and faults of that size cannot be seen"
        )
        found.append(Finding(Severity.WARNING, "healthy_has_gap", sentence, "Diagnose the healthy log by itself first"))
    return found


def _nominal(problem: Problem, key: tuple[str, str]) -> float:
    return next(abs(nominal) for effect, member, nominal, _ in problem.slack if (effect, member) == key)


def _sizes(floor: Floats, dof: np.ndarray) -> str:
    return ", ".join(f"{floor[d]:.2g} {'N' if d < 3 else 'N m'} in {DEGREES_OF_FREEDOM[d]}" for d in dof)
