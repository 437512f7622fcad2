"""A vehicle as all healthy flights at once show it, before each of them is followed by itself.

Where its file is right within slack, that is told already. Else this says which coefficients the file has wrong, in a
third of the time that the whole calibration takes: enough to see that they are few, as after a fault.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from auv_torchrl.diagnosis.calibrate.approach import approach, settled
from auv_torchrl.diagnosis.calibrate.gauge import hold_scale, scaled_as_the_file
from auv_torchrl.diagnosis.calibrate.nuisance import Centred, Nuisance, guessed, stated
from auv_torchrl.diagnosis.calibrate.together import Together, follow_all
from auv_torchrl.diagnosis.calibrate.uncertainty import Coefficient
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.fit import fit_by_simulation, measure_noise, reassess
from auv_torchrl.diagnosis.identify.following import chi2_by_window, follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.identify.paths import Fit, WindowPath, nuisance_now
from auv_torchrl.diagnosis.identify.problem import Known, Problem
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.diagnosis.thresholds import BEYOND_TRIM, STRAYS
from auv_torchrl.effects import EFFECTS
from auv_torchrl.flightlog import FlightLog, join
from auv_torchrl.vehicle import Vehicle

FITS = 8  # at most, of the coefficients of a file that is a guess, while each ...
STILL_FALLS = 2.0  # ... lowers chi-square by this: what no flight tells then follows the prior


@dataclass(frozen=True)
class Draft:
    """A vehicle as far as all of its flights at once tell of it."""

    log: FlightLog  # the flights, joined
    flights: Sequence[Windows]
    centred: Centred  # the vehicle, empty batch, and what may differ from it in another flight
    known: Known  # under the floor of the settings
    strays: tuple[str, ...]  # effects whose coefficients the file has wrong by more than slack
    as_stated: float  # chi-square per number where the file is right within slack
    together: Together | None  # what the flights show together, where the file is right within slack
    given: Vehicle  # as the file says, empty batch,
    coefficients: Sequence[Coefficient]  # and what it says is uncertain


def draft(
    healthy: Sequence[FlightLog], vehicle: Vehicle, settings: Settings, coefficients: Sequence[Coefficient] = ()
) -> Draft:
    """Fit the coefficients of a sound vehicle on all of its flights at once.

    Args:
        healthy: at least one log without the fault; each is a flight.
        vehicle: nominal, empty batch; roll and pitch held or free.
        settings: widths of the slack and the floor to begin from.
        coefficients: what is uncertain in the file; empty for what the effects declare.
    """
    log = join(healthy)
    windows = cut_windows(log, settings.window_s, settings.lead_s, settings.bin_s)
    problem, follow = follow_windows(Problem.of(windows, vehicle, settings))
    nuisance = stated(vehicle, settings, windows.channels)
    problem, fit = _fit(problem, nuisance, follow, 1)
    flights, centred = parted(healthy, windows), Centred.at(vehicle, nuisance)
    known = Known(np.array(settings.floor_force), problem.sigma, problem.rough_noise, (), centred.covariance)
    as_stated = excess = fit.excess
    near = _usual_excess(problem, fit) < BEYOND_TRIM
    together = follow_all(flights, centred, known, settings, settings.excess) if near else None
    if together is not None:
        centred, known, as_stated = together.centred, together.known, together.excess
        if as_stated <= settings.excess:
            return Draft(log, flights, centred, known, (), as_stated, together, vehicle, coefficients)
    strays: tuple[str, ...] = ()
    guess = approach(windows, vehicle, guessed(vehicle, settings, coefficients, windows))
    problem, follow = follow_windows(Problem.of(windows, guess.vehicle, settings))
    problem, refitted = _fit(problem, guess.nuisance, follow, FITS)
    if refitted.excess < excess:
        moved = nuisance_now(problem, refitted.explanation), hold_scale(_left_open(problem, refitted), guess)
        centred = scaled_as_the_file(guess.moved(*moved))
        strays = _strays(settled(centred), settings)
        known = replace(known, noise=problem.sigma)
    return Draft(log, flights, centred, known, strays, as_stated, None, vehicle, coefficients)


def parted(healthy: Sequence[FlightLog], windows: Windows) -> list[Windows]:
    """The windows of each log, of those that have some, in the order in which they are joined."""
    ends = np.cumsum([len(log.episodes) for log in healthy])
    flight = np.searchsorted(ends, windows.episode, side="right")
    return [windows.subset(flight == number) for number in np.unique(flight)]


def _fit(problem: Problem, nuisance: Nuisance, follow: WindowPath, fits: int) -> tuple[Problem, Fit]:
    """Fit what may be off on all flights at once, and measure the noise under it."""
    covariance = np.diag(np.array([width for *_, width in nuisance.entries]) ** 2)
    problem = replace(
        problem, nuisance=nuisance.entries, nuisance_covariance=covariance, nuisance_precision=np.linalg.inv(covariance)
    )
    fit = fit_by_simulation(problem, Explanation(), follow)
    for _ in range(1, fits):
        further = fit_by_simulation(problem, fit.explanation, fit.path)
        falls, fit = fit.chi2 - further.chi2, further
        if not falls > STILL_FALLS:
            break
    if (anew := measure_noise(problem, fit)) is not problem:
        problem, fit = anew, reassess(anew, fit)
    return problem, fit


def _usual_excess(problem: Problem, fit: Fit) -> float:
    """Chi-square per number of the window in the middle.

    Flights whose trims and currents differ lose some windows where they are fitted as one, and leave much on the whole.
    """
    numbers = np.maximum(problem.windows.numbers_of_each, 1.0)
    return float(np.median(chi2_by_window(problem, fit.path.state) / numbers))


def _left_open(problem: Problem, fit: Fit) -> Floats:
    """Covariance (k, k) of slack, as the log leaves it open."""
    k = len(problem.nuisance)
    return np.linalg.inv(fit.quadratic.A[:k, :k] + problem.nuisance_precision)


def _strays(centred: Centred, settings: Settings) -> tuple[str, ...]:
    """Effects of which some coefficient differs from the file by more than slack, and than the logs leave open."""
    found = []
    entries = zip(centred.nuisance.entries, centred.file, np.diag(centred.covariance), strict=True)
    for (effect, member, nominal, _), away, variance in entries:
        width = settings.nuisance_of(EFFECTS[effect]).get(member.rsplit("_", 1)[0], 0.0) * abs(nominal)
        if abs(away) > STRAYS * np.hypot(width, np.sqrt(variance)):
            found.append(effect)
    return tuple(dict.fromkeys(found))
