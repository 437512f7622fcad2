"""What logs of the sound vehicle say before a fault is looked for: its coefficients, its floor, and how it varies.

Three layers are kept apart. What the vehicle's file has wrong is the same in every flight; what differs from flight to
flight, as trim and current do, has a spread; and only what is neither is new. The first two become slack of the search,
with all of their uncertainty.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from torch import Tensor

from auv_torchrl.diagnosis.calibrate.approach import approach
from auv_torchrl.diagnosis.calibrate.flights import Told, share
from auv_torchrl.diagnosis.calibrate.floor import disturbance_floor, sizes_by_axis
from auv_torchrl.diagnosis.calibrate.gauge import hold_scale, scaled_as_the_file
from auv_torchrl.diagnosis.calibrate.nuisance import Centred, Nuisance, guessed, stated
from auv_torchrl.diagnosis.calibrate.one_flight import follow_flight
from auv_torchrl.diagnosis.calibrate.uncertainty import Coefficient
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.fit import fit_by_simulation, measure_noise, reassess
from auv_torchrl.diagnosis.identify.following import follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.identify.judged import Base, Judged, slack_now
from auv_torchrl.diagnosis.identify.problem import Known, Problem
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.motion.reduce import OU_TIME
from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.diagnosis.thresholds import BEYOND_TRIM, COMMON_SCALE, NEAR, STRAYS
from auv_torchrl.effects import EFFECTS
from auv_torchrl.effects.effect import changed
from auv_torchrl.flightlog import Finding, FlightLog, Severity, join
from auv_torchrl.vehicle import Vehicle

PASSES = 6  # coefficients and floor in turn, the last one under the floor that the one before has shown; fewer ...
STANDS = 0.5  # ... where no coefficient moved by more of its standard deviation, or nothing was left
FITS = 8  # at most, of the coefficients of a file that is a guess, while each ...
STILL_FALLS = 2.0  # ... lowers chi-square by this: what no flight tells then follows the prior


@dataclass(frozen=True)
class Calibration:
    """The vehicle as healthy logs show it."""

    centred: Centred  # the vehicle, empty batch, and what may differ from it in another flight
    known: Known
    strays: tuple[str, ...]  # effects whose coefficients the file has wrong by more than slack
    as_stated: float  # chi-square per number where the file is right within slack
    excess: float  # that of the calibrated vehicle, under the floor of the settings
    has_gap: bool  # beyond what the file may have wrong
    findings: tuple[Finding, ...]

    @property
    def vehicle(self) -> Vehicle:
        """The calibrated vehicle, empty batch."""
        return self.centred.vehicle


def calibrate(
    healthy: Sequence[FlightLog], vehicle: Vehicle, settings: Settings, coefficients: Sequence[Coefficient] = ()
) -> Calibration:
    """Fit the coefficients of a sound vehicle, how it varies from flight to flight, and its disturbance floor.

    Where the file is right within slack, that is all that is fitted; else every coefficient that it may have wrong.

    Args:
        healthy: at least one log without the fault; each is a flight.
        vehicle: nominal, empty batch; roll and pitch held or free as they are to be diagnosed.
        settings: widths of the slack and the floor to begin from.
        coefficients: what is uncertain in the file; empty for what the effects declare.
    """
    log = join(healthy)
    windows = cut_windows(log, settings.window_s, settings.lead_s, settings.bin_s)
    problem, follow = follow_windows(Problem.of(windows, vehicle, settings))
    nuisance = stated(vehicle, settings, windows.channels)
    problem, judged = _fit(problem, nuisance, follow, 1)
    flights, centred = _parted(healthy, windows), Centred.at(vehicle, nuisance)
    known = Known(np.array(settings.floor_force), problem.sigma, problem.rough_noise, (), centred.covariance)
    strays: tuple[str, ...] = ()
    as_stated = excess = _excess([judged])
    if excess < BEYOND_TRIM:
        centred, known, excess = _over_flights(flights, centred, known, settings, settings.excess)
        as_stated = excess
    if as_stated > settings.excess:
        near = approach(windows, vehicle, guessed(vehicle, settings, coefficients, windows))
        problem, follow = follow_windows(Problem.of(windows, near.vehicle, settings))
        problem, refitted = _fit(problem, near.nuisance, follow, FITS)
        if _excess([refitted]) < _excess([judged]):
            moved = slack_now(problem, refitted.explanation), hold_scale(_left_open(problem, refitted), near)
            centred = scaled_as_the_file(near.moved(*moved))
            strays = _strays(centred, settings)
            known = replace(known, noise=problem.sigma, scale=COMMON_SCALE)
        centred, known, excess = _over_flights(flights, centred, known, settings)
    calibration = Calibration(centred, known, strays, as_stated, excess, excess > settings.excess, ())
    return replace(calibration, findings=tuple(_findings(log, calibration, settings)))


def calibrate_free(healthy: Sequence[FlightLog], level: Calibration, free: Tensor, settings: Settings) -> Calibration:
    """The same for the degrees of freedom ``free`` (6,), from what was calibrated with the vehicle held level.

    Roll and pitch that nobody measured are seen by what they do to the rest, and that is little: a fit of all
    coefficients that begins elsewhere would be led astray by them.
    """
    log = join(healthy)
    windows = cut_windows(log, settings.window_s, settings.lead_s, settings.bin_s)
    centred = replace(level.centred, vehicle=changed(level.vehicle, free=free))
    known = replace(level.known, floor=np.array(settings.floor_force))
    centred, known, excess = _over_flights(_parted(healthy, windows), centred, known, settings)
    freed = replace(level, centred=centred, known=known, excess=excess, has_gap=excess > settings.excess)
    return replace(freed, findings=tuple(_findings(log, freed, settings)))


def _over_flights(
    flights: Sequence[Windows], centred: Centred, known: Known, settings: Settings, most: float = np.inf
) -> tuple[Centred, Known, float]:
    """What flights share, how they differ, the floor (6,), and the excess under the one to begin from.

    Of an excess of more than ``most``, nothing else: then another vehicle is needed.
    """
    excess, shrinks, is_last = np.inf, None, False
    for turn in range(PASSES):
        known = replace(known, slack=centred.nuisance.slack, slack_covariance=centred.covariance)
        fitted = [follow_flight(own, centred.vehicle, settings, known) for own in flights]
        left = _excess([judged for _, judged in fitted])
        excess = excess if is_last else min(excess, left)
        if excess > most:
            return centred, known, excess
        if is_last and left > max(NEAR, excess):  # windows were lost under the smaller floor: no disturbance
            break
        dof, floor = fitted[0][0].layout.dof, known.floor.copy()
        floor[dof] = disturbance_floor(fitted)
        shared = share([_tells(*_under(one, floor[dof])) for one in fitted], centred)
        open_still = hold_scale(shared.covariance, centred) if known.scale else shared.covariance
        centred = centred.moved(shared.mean, open_still, shared.sizes)
        shrinks = centred.covariance - centred.nuisance.between_flights(shared.sizes)
        still = np.abs(shared.mean) < STANDS * np.sqrt(np.diag(open_still))
        if is_last or left <= 1 or still.all() or turn == PASSES - 2:
            known = replace(known, floor=floor)
            if is_last:
                break
            is_last = True
    known = replace(known, slack=centred.nuisance.slack, slack_covariance=centred.covariance)
    return centred, replace(known, flights=len(flights), shrinks=shrinks), excess


def noise_findings(noisier: dict[str, float]) -> tuple[Finding, ...]:
    """A warning about channels that are so many times noisier than on the healthy log."""
    if not noisier:
        return ()
    sizes = ", ".join(f"{name} {times:.1f} times" for name, times in noisier.items())
    sentence = f"the sensors are noisier than on the healthy log: {sizes}; their noise is fitted on this log instead"
    return (Finding(Severity.WARNING, "noisier_than_healthy", sentence, columns=tuple(noisier)),)


def _fit(problem: Problem, nuisance: Nuisance, follow: Base, fits: int) -> tuple[Problem, Judged]:
    """Fit what may be off on all flights at once, and measure the noise under it."""
    covariance = np.diag(np.array([width for *_, width in nuisance.slack]) ** 2)
    problem = replace(
        problem, slack=nuisance.slack, slack_covariance=covariance, slack_precision=np.linalg.inv(covariance)
    )
    judged = fit_by_simulation(problem, Explanation(), follow)
    for _ in range(1, fits):
        further = fit_by_simulation(problem, judged.explanation, judged.base)
        falls, judged = judged.chi2 - further.chi2, further
        if not falls > STILL_FALLS:
            break
    if (anew := measure_noise(problem, judged)) is not problem:
        problem, judged = anew, reassess(anew, judged)
    return problem, judged


def _under(flight: tuple[Problem, Judged], floor: Floats) -> tuple[Problem, Judged]:
    """A flight fitted again under another disturbance (D,)."""
    problem, judged = flight
    problem = replace(problem, floor=floor)
    return problem, fit_by_simulation(problem, judged.explanation, judged.base)


def _tells(problem: Problem, judged: Judged) -> Told:
    return Told.of(judged.quadratic, slack_now(problem, judged.explanation))


def _left_open(problem: Problem, judged: Judged) -> Floats:
    """Covariance (k, k) of slack, as the log leaves it open."""
    k = len(problem.slack)
    return np.linalg.inv(judged.quadratic.A[:k, :k] + problem.slack_precision)


def _parted(healthy: Sequence[FlightLog], windows: Windows) -> list[Windows]:
    """The windows of each log, of those that have some, in the order in which they are joined."""
    ends = np.cumsum([len(log.episodes) for log in healthy])
    flight = np.searchsorted(ends, windows.episode, side="right")
    return [windows.subset(flight == number) for number in np.unique(flight)]


def _excess(flights: Sequence[Judged]) -> float:
    """Chi-square per measured number."""
    return sum(judged.chi2 for judged in flights) / sum(judged.quadratic.numbers for judged in flights)


def _strays(centred: Centred, settings: Settings) -> tuple[str, ...]:
    """Effects of which some coefficient differs from the file by more than slack, and than the logs leave open."""
    found = []
    entries = zip(centred.nuisance.slack, centred.file, np.diag(centred.covariance), strict=True)
    for (effect, member, nominal, _), away, variance in entries:
        width = settings.slack_of(EFFECTS[effect]).get(member.rsplit("_", 1)[0], 0.0) * abs(nominal)
        if abs(away) > STRAYS * np.hypot(width, np.sqrt(variance)):
            found.append(effect)
    return tuple(dict.fromkeys(found))


def _findings(log: FlightLog, calibration: Calibration, settings: Settings) -> list[Finding]:
    excess, known, corrections = calibration.excess, calibration.known, calibration.centred.corrections
    largest = ""
    if corrections:
        most = max(corrections, key=lambda key: abs(corrections[key]))
        largest = f"; the largest correction is {' '.join(most)} {corrections[most]:+.3f}"
    dof = np.flatnonzero(calibration.vehicle.free.numpy() > 0)
    sentence = (
        f"the verdict rests on the healthy log {log.name} ({log.duration:.0f} s): disturbance of "
        f"{sizes_by_axis(known.floor, dof)} over {OU_TIME:g} s, coefficients calibrated on it{largest}"
    )
    found = [Finding(Severity.INFO, "floor_measured", sentence)]
    if calibration.as_stated > settings.excess:
        sentence = (
            f"the vehicle's file is off by more than slack: {len(known.slack)} coefficients were corrected on the "
            f"healthy log {log.name} (chi-square {calibration.as_stated:.3g} per number before, {excess:.3g} after); "
            "what is found is relative to the vehicle of that log"
        )
        found.append(Finding(Severity.INFO, "coefficients_corrected", sentence))
    if calibration.has_gap:
        sentence = (
            f"the healthy log {log.name} departs from the simulator by more than coefficients can explain "
            f"(chi-square {excess:.2f} per number): what is left of it counts as disturbance, and faults of that size "
            "cannot be seen"
        )
        found.append(Finding(Severity.WARNING, "healthy_has_gap", sentence, "Diagnose the healthy log by itself first"))
    return found
