"""The healthy vehicle: coefficients, disturbance, and how flights differ, before a fault is looked for.

A first fit treats all flights as one. Where the file is right within the settings' widths, each flight is then fitted
within these widths, and that is all. Otherwise :func:`draft` says which coefficients the file has wrong, in half of
the time of the whole calibration: enough to see that they are few, as after a fault. :func:`calibrate_draft` then fits
each flight by itself. Where flights leave more than any coefficients explain, the vehicle that predicts them best is
taken instead.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from auv_torchrl.diagnosis.axes import hold_attitude, is_hidden
from auv_torchrl.diagnosis.calibrate.correction import PredictionGain, correct_file, measure_own_floor
from auv_torchrl.diagnosis.calibrate.flights import PASSES, FlightsFit, fit_flights, sizes_by_axis
from auv_torchrl.diagnosis.calibrate.output_error import fit_coefficients, simulate_errors
from auv_torchrl.diagnosis.calibrate.parameters import (
    Coefficient,
    NuisanceParameters,
    VehicleEstimate,
    guess_nuisance,
    list_guesses,
    make_coefficients,
    state_nuisance,
)
from auv_torchrl.diagnosis.calibrate.scale_ambiguity import hold_scale, measure_ambiguity, restore_file_scale
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.fit import fit_by_simulation, measure_noise, reassess
from auv_torchrl.diagnosis.identify.following import chi2_by_window, follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.identify.paths import Fit, WindowPath, nuisance_now
from auv_torchrl.diagnosis.identify.problem import HealthyPrior, Problem
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.motion.reduce import OU_TIME
from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.diagnosis.thresholds import BEYOND_TRIM, HORIZONS_S, STRAYS, TILT_PASSES, WORTH_A_CORRECTION
from auv_torchrl.effects import EFFECTS
from auv_torchrl.effects.effect import changed
from auv_torchrl.flightlog import Finding, FlightLog, Severity, join
from auv_torchrl.quantities import counted, percent, words
from auv_torchrl.vehicle import Vehicle

MOST_WINDOWS = 60  # two minutes: what more windows tell is fitted later, with their disturbance
FITS = 8  # of the coefficients of a file that is a guess, at most, ...
STILL_FALLS = 2.0  # ... while each lowers chi-square by this: what no flight tells then follows the prior
FEWEST_TO_LEAVE_ONE = 3  # flights, so that all of them show a vehicle near that of the others


@dataclass(frozen=True)
class Draft:
    """A vehicle as all of its flights at once show it."""

    log: FlightLog  # the flights, joined
    flights: Sequence[Windows]
    estimate: VehicleEstimate
    prior: HealthyPrior  # under the floor of the settings
    wrong_effects: tuple[str, ...]  # whose coefficients the file has wrong by more than the settings' widths
    file_excess: float  # chi-square per number under a file that is right within the settings' widths
    flights_fit: FlightsFit | None  # where the file is right within the settings' widths
    file: Vehicle  # as the file says, empty batch
    coefficients: tuple[Coefficient, ...]  # what the file says is uncertain


def draft(
    healthy: Sequence[FlightLog], vehicle: Vehicle, settings: Settings, coefficients: Sequence[Coefficient] = ()
) -> Draft:
    """Fit the coefficients of a healthy vehicle on all of its flights at once.

    Args:
        healthy: at least one log without the fault; each is a flight.
        vehicle: nominal, empty batch; roll and pitch held or free.
        settings: widths of the nuisance parameters and the floor to begin from.
        coefficients: what is uncertain in the file; empty for what the effects declare.
    """
    log = join(healthy)
    windows = cut_windows(log, settings.window_s, settings.lead_s, settings.bin_s)
    some = windows.thinned(MOST_WINDOWS)
    problem, path = follow_windows(Problem.of(some, vehicle, settings))
    nuisance = state_nuisance(vehicle, settings, windows.channels)
    problem, fit = _fit_nuisance(problem, nuisance, path, 1)
    flights, estimate = split_by_flight(healthy, windows), VehicleEstimate.from_file(vehicle, nuisance)
    floor = np.array(settings.floor_force)
    prior = HealthyPrior(floor, problem.sigma, problem.rough_noise, (), estimate.covariance)
    given, file_excess = (vehicle, tuple(coefficients)), fit.excess
    excess, is_near = fit.excess, _median_excess(problem, fit) < BEYOND_TRIM
    del problem, path, fit  # beside the flights one by one they would fill the memory
    if is_near:
        flights_fit = fit_flights(flights, estimate, prior, settings, settings.excess)
        estimate, prior, file_excess = flights_fit.estimate, flights_fit.prior, flights_fit.excess
        if file_excess <= settings.excess:
            return Draft(log, flights, estimate, prior, (), file_excess, flights_fit, *given)
    wrong_effects: tuple[str, ...] = ()
    guess = approach(some, vehicle, guess_nuisance(vehicle, settings, coefficients, windows))
    problem, path = follow_windows(Problem.of(some, guess.vehicle, settings))
    problem, refitted = _fit_nuisance(problem, guess.nuisance, path, FITS)
    if refitted.excess < excess:
        covariance = hold_scale(_posterior_covariance(problem, refitted), guess)
        estimate = restore_file_scale(guess.updated(nuisance_now(problem, refitted.explanation), covariance))
        wrong_effects = _find_wrong_effects(estimate.without_fixed_properties(), settings)
        prior = replace(prior, noise=problem.sigma)
    return Draft(log, flights, estimate, prior, wrong_effects, file_excess, None, *given)


def approach(windows: Windows, file: Vehicle, nuisance: NuisanceParameters) -> VehicleEstimate:
    """A vehicle that predicts windows from their starts, near enough to the true one to be linearised about.

    Against the disturbance of a healthy vehicle, a fit from afar ends in the wrong place: as long as nothing explains
    the log, a vehicle of small moments is cheapest, because the disturbance that makes up for them is small, too.
    Predicted from its commands alone, a vehicle of small moments moves wrongly.

    Args:
        windows: of healthy flight, so short that a vehicle from afar stays near.
        file: the vehicle as its file says, empty batch.
        nuisance: the uncertain numbers of the file.
    """
    coefficients = make_coefficients(nuisance.entries, file)
    fitted = fit_coefficients(windows, file, coefficients)
    before = np.array([c.nominal for c in coefficients])
    near = VehicleEstimate.from_file(file, nuisance).updated(fitted.values - before, fitted.covariance)
    # Guesses are wrong by factors: a drag of 2 that is guessed within 1 and turns out to be 10 was guessed within 5.
    now = np.array([nominal for *_, nominal, _ in near.nuisance.entries])
    grown = np.maximum(np.abs(now / np.where(before, before, np.inf)), 1.0)
    wide = replace(near.nuisance, width=near.nuisance.width * grown)
    return replace(near, nuisance=wide).with_covariance(np.diag(wide.width**2) + wide.between_flights())


def split_by_flight(healthy: Sequence[FlightLog], windows: Windows) -> list[Windows]:
    """The windows of each log that has some, in the order in which the logs are joined."""
    ends = np.cumsum([len(log.episodes) for log in healthy])
    flight = np.searchsorted(ends, windows.episode, side="right")
    return [windows.subset(flight == number) for number in np.unique(flight)]


def _fit_nuisance(problem: Problem, nuisance: NuisanceParameters, path: WindowPath, fits: int) -> tuple[Problem, Fit]:
    """Fit nuisance parameters on all flights at once, and measure the noise under them."""
    covariance = np.diag(np.array([width for *_, width in nuisance.entries]) ** 2)
    problem = replace(
        problem, nuisance=nuisance.entries, nuisance_covariance=covariance, nuisance_precision=np.linalg.inv(covariance)
    )
    fit = fit_by_simulation(problem, Explanation(), path)
    for _ in range(1, fits):
        further = fit_by_simulation(problem, fit.explanation, fit.path)
        falls, fit = fit.chi2 - further.chi2, further
        if not falls > STILL_FALLS:
            break
    if (anew := measure_noise(problem, fit)) is not problem:
        problem, fit = anew, reassess(anew, fit)
    return problem, fit


def _median_excess(problem: Problem, fit: Fit) -> float:
    """Chi-square per number of the median window.

    Flights whose trims and currents differ lose some windows where they are fitted as one, which spoils the mean.
    """
    numbers = np.maximum(problem.windows.numbers_of_each, 1.0)
    return float(np.median(chi2_by_window(problem, fit.path.state) / numbers))


def _posterior_covariance(problem: Problem, fit: Fit) -> Floats:
    """Covariance (k, k) of the nuisance parameters after the log."""
    k = len(problem.nuisance)
    return np.linalg.inv(fit.quadratic.A[:k, :k] + problem.nuisance_precision)


def _find_wrong_effects(estimate: VehicleEstimate, settings: Settings) -> tuple[str, ...]:
    """Effects with a coefficient that differs from the file by more than its width and its uncertainty."""
    found = []
    entries = zip(estimate.nuisance.entries, estimate.file_offset, np.diag(estimate.covariance), strict=True)
    for (effect, member, nominal, _), offset, variance in entries:
        width = settings.nuisance_of(EFFECTS[effect]).get(member.rsplit("_", 1)[0], 0.0) * abs(nominal)
        if abs(offset) > STRAYS * np.hypot(width, np.sqrt(variance)):
            found.append(effect)
    return tuple(dict.fromkeys(found))


@dataclass(frozen=True)
class Calibration:
    """The vehicle as healthy flights show it."""

    estimate: VehicleEstimate
    prior: HealthyPrior  # of the search
    wrong_effects: tuple[str, ...]  # whose coefficients the file has wrong by more than the settings' widths
    file_excess: float  # chi-square per number under a file that is right within the settings' widths
    excess: float  # that of the calibrated vehicle, under the floor of the settings
    has_gap: bool  # beyond what the file may have wrong
    findings: tuple[Finding, ...]
    flights_fit: FlightsFit | None = None  # what each flight tells, where the flights are at hand

    @property
    def vehicle(self) -> Vehicle:
        """The calibrated vehicle, empty batch."""
        return self.estimate.vehicle

    @property
    def tilts(self) -> bool:
        """Whether the vehicle may roll or pitch."""
        return bool((self.vehicle.free[3:5] > 0).any())

    def with_free_tilts(self) -> "Calibration":
        """The same calibration of a vehicle that may roll and pitch."""
        vehicle = changed(self.vehicle, free=np.ones(6))
        return replace(self, estimate=replace(self.estimate, vehicle=vehicle))


def calibrate(
    healthy: Sequence[FlightLog],
    vehicle: Vehicle,
    settings: Settings,
    coefficients: Sequence[Coefficient] = (),
    free: Floats | None = None,
) -> Calibration:
    """Fit the coefficients of a healthy vehicle, how it differs from flight to flight, and its disturbance.

    Where the file is right within the settings' widths, numbers move within these. Otherwise every coefficient that
    the file may have wrong is fitted, and whether the vehicle rolls and pitches.

    Args:
        healthy: at least one log without the fault; each is a flight.
        vehicle: nominal, empty batch; roll and pitch held or free as they are to be diagnosed.
        settings: widths of the nuisance parameters and the floor to begin from.
        coefficients: what is uncertain in the file; empty for what the effects declare.
        free: degrees of freedom (6,) of a vehicle that is held level because nobody measured how it tilts; None where
            tilts are measured.
    """
    return calibrate_draft(draft(healthy, vehicle, settings, coefficients), settings, free)


def calibrate_draft(drafted: Draft, settings: Settings, free: Floats | None = None) -> Calibration:
    """The calibration to which a draft leads; ``settings`` and ``free`` as of :func:`calibrate`."""
    flights_fit, estimate, prior = drafted.flights_fit, drafted.estimate, drafted.prior
    if flights_fit is None:
        passes = PASSES
        if free is not None:
            estimate = _choose_tilts(drafted.flights, estimate, prior, settings, free)
            passes = PASSES - TILT_PASSES
        flights_fit = fit_flights(drafted.flights, estimate, prior, settings, passes=passes)
    found = _conclude(flights_fit, drafted.wrong_effects, drafted.file_excess, drafted.log, settings)
    given = drafted.log, drafted.file, found.vehicle, settings, drafted.coefficients
    better = calibrate_by_prediction(*given) if found.has_gap else None
    if better is None:
        return found
    estimate, prior, excess = better
    found = replace(found, estimate=estimate, prior=prior, excess=excess, flights_fit=None)
    return replace(found, findings=tuple(_list_findings(drafted.log, found, settings)))


def calibrate_attitude(
    healthy: Sequence[FlightLog], vehicle: Vehicle, settings: Settings, coefficients: Sequence[Coefficient] = ()
) -> Calibration:
    """The calibration of a vehicle that is held level or may tilt, as its flights demand; see :func:`calibrate`."""
    log = join(healthy)
    free = vehicle.free if is_hidden(log, vehicle) else None
    return calibrate(healthy, hold_attitude(log, vehicle), settings, coefficients, free)


def _choose_tilts(
    flights: Sequence[Windows], level: VehicleEstimate, prior: HealthyPrior, settings: Settings, free: Floats
) -> VehicleEstimate:
    """The vehicle held level or with the degrees of freedom ``free`` (6,), whichever makes the flights likelier.

    A disturbance makes up for the tilts that a level vehicle lacks, so the misfit tells nothing of tilts. Both vehicles
    begin before any calibration, because a calibrated level vehicle already makes up for its lack of tilts.
    """
    both, odds = (level, replace(level, vehicle=changed(level.vehicle, free=free))), 0.0
    for _ in range(TILT_PASSES):
        held, tilting = (fit_flights(flights, begin, prior, settings, passes=1) for begin in both)
        both, odds = (held.with_fixed, tilting.with_fixed), tilting.log_likelihood - held.log_likelihood
    return both[odds > 0]


def calibrate_free(healthy: Sequence[FlightLog], level: Calibration, free: Floats, settings: Settings) -> Calibration:
    """The calibration with the degrees of freedom ``free`` (6,), from that of the vehicle held level.

    Roll and pitch that nobody measured show only in what they do to other motions, and that is little. A fit of all
    coefficients that begins elsewhere would be led astray by them.
    """
    log = join(healthy)
    windows = cut_windows(log, settings.window_s, settings.lead_s, settings.bin_s)
    begin = level.flights_fit.with_fixed if level.flights_fit else level.estimate
    estimate = replace(begin, vehicle=changed(begin.vehicle, free=free))
    prior = replace(level.prior, floor=np.array(settings.floor_force))
    flights_fit = fit_flights(split_by_flight(healthy, windows), estimate, prior, settings)
    return _conclude(flights_fit, level.wrong_effects, level.file_excess, log, settings)


def leave_out(
    calibration: Calibration, healthy: Sequence[FlightLog], place: int, settings: Settings
) -> Calibration | None:
    """The calibration on all of these flights but one, from the calibration on all of them.

    None where the flights do not show one vehicle: the flight that is left out may then have led the others to a
    vehicle that explains it too. None also for two flights, because one of them alone may lie far from both.
    """
    flights_fit = calibration.flights_fit
    few = len(healthy) < FEWEST_TO_LEAVE_ONE
    if flights_fit is None or few or flights_fit.first_excess > settings.excess:
        return None
    if len(flights_fit.information) != len(healthy):
        return None
    others = join([log for k, log in enumerate(healthy) if k != place])
    rest = flights_fit.without_flight(place)
    return _conclude(rest, calibration.wrong_effects, calibration.file_excess, others, settings)


def _conclude(
    flights_fit: FlightsFit, wrong_effects: tuple[str, ...], file_excess: float, log: FlightLog, settings: Settings
) -> Calibration:
    """The calibration of fitted flights, with findings about ``log``, which joins them."""
    excess = flights_fit.excess
    has_gap = excess > settings.excess
    prior, estimate = flights_fit.prior, flights_fit.estimate
    if estimate.nuisance.is_guess:
        prior = replace(prior, scales=measure_ambiguity(estimate, flights_fit.hides_tilts))
    found = Calibration(estimate, prior, wrong_effects, file_excess, excess, has_gap, (), flights_fit)
    return replace(found, findings=tuple(_list_findings(log, found, settings)))


def calibrate_by_prediction(
    log: FlightLog, vehicle: Vehicle, than: Vehicle, settings: Settings, coefficients: tuple[Coefficient, ...]
) -> tuple[VehicleEstimate, HealthyPrior, float] | None:
    """A vehicle that predicts windows of healthy flights better than another one, its prior and its excess.

    Real flights leave more than any coefficients explain: tethers, wakes, filters in the sensors. A fit against noise
    and disturbance then bends coefficients to make up for these, and flies worse than a fit of predictions.

    None where no such vehicle predicts better, or where the fit to each half of the flights predicts the other no
    better. The excess is chi-square per number, under the floor of the settings.

    Args:
        log: the flights, joined.
        vehicle: as its file says, empty batch.
        than: as it was calibrated against noise and disturbance, empty batch.
        settings: of the diagnosis.
        coefficients: what is uncertain in the file; empty for all that effects declare.
    """
    coefficients = coefficients or make_coefficients(list_guesses(vehicle), vehicle)
    corrected = correct_file(log, vehicle, coefficients, settings)
    own, about = corrected.prior, corrected.estimate
    if own is None or about is None or not _predicts_better(log, corrected.vehicle, than, settings):
        return None
    windows = cut_windows(log, settings.window_s, settings.lead_s, settings.bin_s)
    problem, path = follow_windows(Problem.of(windows, corrected.vehicle, settings, own))
    fit = fit_by_simulation(problem, Explanation(), path, rounds=0)
    problem = measure_own_floor(problem, path)
    floor = np.array(settings.floor_force)
    floor[problem.layout.dof] = problem.floor
    prior = replace(own, floor=floor, noise=problem.sigma, rough_noise=problem.rough_noise, of_itself=False)
    widths = {(c.effect, c.member): c.width for c in coefficients}
    width = np.array([widths.get(entry[:2], entry[3]) for entry in prior.nuisance])
    offset = np.zeros_like(width)
    offset[: len(about.file_offset)] = about.file_offset  # what was not fitted is as the file says
    estimate = VehicleEstimate.without_spread(corrected.vehicle, prior.nuisance, prior.nuisance_covariance)
    nuisance = replace(estimate.nuisance, width=width)
    return replace(estimate, nuisance=nuisance, file_offset=offset), prior, fit.excess


def _predicts_better(log: FlightLog, vehicle: Vehicle, than: Vehicle, settings: Settings) -> bool:
    """Whether a vehicle predicts windows of the longest horizon better than another one, by enough to be worth it."""
    windows = cut_windows(log, HORIZONS_S[-1], settings.lead_s)
    before, after = (simulate_errors(windows, one, [{}])[0] for one in (than, vehicle))
    return PredictionGain.of(windows, before, after).share > WORTH_A_CORRECTION


def noise_findings(noisier: dict[str, float]) -> tuple[Finding, ...]:
    """A warning about channels that are so many times noisier than on the healthy log."""
    if not noisier:
        return ()
    sizes = ", ".join(f"{name} {times:.1f} times" for name, times in noisier.items())
    sentence = f"the sensors are noisier than on the healthy log: {sizes}; their noise is fitted on this log instead"
    return (Finding(Severity.WARNING, "noisier_than_healthy", sentence, columns=tuple(noisier)),)


def _list_findings(log: FlightLog, calibration: Calibration, settings: Settings) -> list[Finding]:
    excess, prior, corrections = calibration.excess, calibration.prior, calibration.estimate.corrections
    largest = ""
    if corrections:
        most = max(corrections, key=lambda key: abs(corrections[key]))
        largest = f"; the largest correction is {words(' '.join(most))} {percent(corrections[most], sign=True)}"
    dof = np.flatnonzero(calibration.vehicle.free > 0)
    sentence = (
        f"the verdict rests on the healthy log {log.name} ({log.duration:.0f} s): disturbance of "
        f"{sizes_by_axis(prior.floor, dof)} over {OU_TIME:g} s, coefficients calibrated on it{largest}"
    )
    found = [Finding(Severity.INFO, "floor_measured", sentence)]
    if calibration.file_excess > settings.excess:
        sentence = (
            f"the vehicle's file is off by more than a few per cent: {counted(len(prior.nuisance), 'coefficient')} "
            f"corrected on the healthy log {log.name} (chi-square {calibration.file_excess:.3g} per number before, "
            f"{excess:.3g} after); what is found is relative to the vehicle of that log"
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
