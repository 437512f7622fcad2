"""Explain a log: from a moment on or as a whole, with a level vehicle or one that may tilt."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from auv_torchrl.diagnosis.axes import (
    attitude_finding,
    hold_attitude,
    is_hidden,
    level_enough,
)
from auv_torchrl.diagnosis.calibrate.calibration import Calibration, calibrate_draft, calibrate_free, draft
from auv_torchrl.diagnosis.calibrate.correction import measure_own_floor
from auv_torchrl.diagnosis.calibrate.parameters import Coefficient
from auv_torchrl.diagnosis.calibrate.vehicle_file import StoredCalibration
from auv_torchrl.diagnosis.identify.before_effects import Onset, find_onset, follow_agreeing, is_absent
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.following import follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.identify.paths import Fit, log_likelihood
from auv_torchrl.diagnosis.identify.problem import HealthyPrior, Problem
from auv_torchrl.diagnosis.identify.search import Found, Progress, search
from auv_torchrl.diagnosis.lengths import spread
from auv_torchrl.diagnosis.localize.unlike import evidence_of_unlike
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import SIMULATED
from auv_torchrl.diagnosis.verdict import Verdict
from auv_torchrl.flightlog import Finding, FlightLog, Severity, join
from auv_torchrl.vehicle import Vehicle

SIMPLE = 2  # values that explain a log wholly with a level vehicle: tilts, which bend everything, then play no part
FOLLOWED_AGAIN = 0.75  # share of the work that is done when a log is followed along what was found
PIECES, PIECE_S = 4, 8.0  # of a log, and s: what must be explained before it is asked whether all is
HINTS = 2  # explanations of a level vehicle that are tried on one that may tilt, the best one first


# By whether roll and pitch are hidden: the vehicle as healthy logs show it, or the fault that they show.
Calibrated = dict[bool, tuple[Calibration | None, Explanation | None]]


@dataclass(frozen=True)
class LogSearch:
    """A log explained under one assumption about the attitude."""

    found: Found
    sound: Calibration | None
    onset: Onset | None = None  # what is explained are the windows behind it
    attitude: tuple[Finding, ...] = ()
    contradiction: tuple[Finding, ...] = ()  # why the healthy logs are not used


def search_log(
    training: FlightLog,
    vehicle: Vehicle,
    sound: Calibration | None,
    settings: Settings,
    report: Progress,
    seen: LogSearch | None = None,
    left: HealthyPrior | None = None,
) -> LogSearch:
    """Explain a log with a vehicle, or with what was calibrated of it on healthy logs.

    ``left`` is what this log leaves open of a vehicle whose file was corrected on it. ``seen`` is what a vehicle with
    another attitude showed: its explanations are tried too, on the same windows, and what is far behind it is not
    worked out.
    """
    own, known = (sound.vehicle, sound.prior) if sound else (vehicle, left)
    begin = hints_of(seen.found) if seen else []

    windows = cut_windows(training, settings.window_s, settings.lead_s, settings.bin_s)
    problem, follow = follow_agreeing(Problem.of(windows, own, settings, known))
    if known is not None and known is left:
        problem = measure_own_floor(problem, follow)
    report("following the log", 0.2)
    onset = seen.onset if seen else find_onset(problem, follow)
    problem.freedoms.clear()  # of what led here; a search of some windows would keep those of all
    if onset is None:
        found = search(problem, follow, report, begin, unknown=evidence_of_unlike)
        return LogSearch(search_along(problem, found, report), sound)
    plain = replace(problem, windows=replace(problem.windows, whitening=None))  # parts of it are whitened anew
    measured, sensor = problem.known, follow.explanation
    del problem, follow  # the whole log would fill the memory beside the part
    behind, its_follow = follow_agreeing(Problem.of(plain.windows.subset(onset.behind), own, settings, measured))
    found = search(behind, its_follow, report, begin, unknown=evidence_of_unlike)
    if seen or is_absent(plain, onset, found.best.explanation, own, settings):
        del plain
        return LogSearch(search_along(behind, found, report), sound, onset)
    hints = _each_once(found.fits)[:SIMULATED]
    del behind, its_follow, found, plain  # and the part beside the whole
    problem, follow = follow_windows(Problem.of(windows, own, settings, measured), sensor)
    whole = search(problem, follow, report, hints, further=False)
    return LogSearch(search_along(problem, whole, report), sound)


def search_along(problem: Problem, found: Found, report: Progress) -> Found:
    """Where errors are no white noise and something is left, weigh what was simulated along what was found.

    What such errors amount to follows from the motion and from the vehicle: a dead thruster makes none, and beside a
    large fault sound samples look like outliers.
    """
    best = replace(found.best.explanation, nuisance={})
    if not problem.given.errors.coloured or not best.effects or found.excess < problem.settings.excess:
        return found
    hints = _each_once([found.best, *found.fits])[:SIMULATED]
    report("following what was found", FOLLOWED_AGAIN)
    again = search(*follow_windows(problem, best), report, hints, further=False)
    return again if again.excess < found.excess else found


def healthy_not_healthy(healthy: Sequence[FlightLog], fault: Explanation) -> Finding:
    """What is said of healthy logs that show a fault themselves."""
    names = " and ".join(name.replace("_", " ") for name in fault.effects)
    sentence = (
        f"the healthy log {', '.join(log.name for log in healthy)} is not healthy: {names} explains its departure from "
        "the vehicle's file; it is not used, and what is found is relative to the file"
    )
    remedy = "Give a log from before the fault, or correct the vehicle's file if this is how it has always been"
    return Finding(Severity.WARNING, "healthy_not_healthy", sentence, remedy)


def search_both_attitudes(
    training: FlightLog,
    vehicle: Vehicle,
    healthy: Sequence[FlightLog],
    settings: Settings,
    report: Progress,
    coefficients: Sequence[Coefficient] = (),
    kept: StoredCalibration | None = None,
    left: HealthyPrior | None = None,
    calibrated: Calibrated | None = None,
) -> LogSearch:
    """Explain a log; where it hides roll and pitch and shows a gap, with a level and with a free vehicle.

    ``kept`` is what the vehicle's file keeps of healthy logs, for where there are none, and ``left`` what this log
    leaves open of a file that was corrected on it. ``calibrated`` keeps what healthy logs show, for other parts of the
    same log: it takes longer than the rest.
    """
    hidden = is_hidden(training, vehicle)
    held = hold_attitude(training, vehicle)
    free = vehicle.free if hidden else None
    sound = kept.calibration(held) if kept and not healthy else None
    if healthy:
        calibrated = {} if calibrated is None else calibrated
        if hidden not in calibrated:
            calibrated[hidden] = _calibrate(healthy, vehicle, held, free, settings, report, coefficients)
        sound, fault = calibrated[hidden]
        if fault is not None:
            searched = search_both_attitudes(training, vehicle, (), settings, report)
            return replace(searched, contradiction=(healthy_not_healthy(healthy, fault),))
    if sound is not None and hidden and sound.tilts:
        return search_log(training, vehicle, sound, settings, report)
    level = search_log(training, held, sound, settings, report, left=left)
    best = level.found.best
    if not hidden or judge(level.found) is Verdict.NO_GAP:
        return level
    if best.nothing_left and len(best.explanation.terms) <= SIMPLE:
        return replace(level, attitude=(level_enough(),))
    if sound is not None:
        sound = calibrate_free(healthy, sound, vehicle.free, settings) if healthy else sound.with_free_tilts()
    tilting = search_log(training, vehicle, sound, settings, report, level, left)
    odds = log_likelihood(tilting.found.problem, tilting.found.best) - log_likelihood(level.found.problem, best)
    better = tilting if odds > 0 else level
    return replace(better, attitude=(attitude_finding(odds > 0, abs(odds)),))


def search_pieces(
    log: FlightLog, vehicle: Vehicle, settings: Settings, report: Progress, left: HealthyPrior | None = None
) -> LogSearch:
    """Explain some pieces of a log: what leaves much of them leaves much of it, and shows so in a fraction of the time.

    Raises:
        FlightLogError: if the pieces are too short for the settings.
    """
    return search_both_attitudes(spread(log, PIECES, PIECE_S), vehicle, (), settings, report, left=left)


def is_long(log: FlightLog) -> bool:
    """Whether to explain some pieces of a log first takes a fraction of the time."""
    return log.duration > 2 * PIECES * PIECE_S


def _calibrate(
    healthy: Sequence[FlightLog],
    vehicle: Vehicle,
    held: Vehicle,
    free: Floats | None,
    settings: Settings,
    report: Progress,
    coefficients: Sequence[Coefficient],
) -> tuple[Calibration | None, Explanation | None]:
    """The vehicle as healthy logs show it, or the fault that they show."""
    drafted = draft(healthy, held, settings, coefficients)
    few = 0 < len(drafted.wrong_effects) <= settings.most_effects
    if few and (fault := _fault_of(healthy, vehicle, settings, report)) is not None:
        return None, fault
    sound = calibrate_draft(drafted, settings, free)
    return sound, _fault_of(healthy, vehicle, settings, report) if sound.has_gap and not few else None


def _fault_of(
    healthy: Sequence[FlightLog], vehicle: Vehicle, settings: Settings, report: Progress
) -> Explanation | None:
    """The few effects that explain all of what healthy logs show of a vehicle; None where that is none.

    Many coefficients that are off, or something unknown, are what calibration and floor are for. A few effects that
    explain all of it are a fault that was there already.
    """
    log = join(healthy)
    if is_long(log) and not is_explained(search_pieces(log, vehicle, settings, report).found):
        return None
    found = search_both_attitudes(log, vehicle, (), settings, report).found
    return found.best.explanation if judge(found) is Verdict.EXPLAINED else None


def hints_of(found: Found) -> list[Explanation]:
    """The best explanation and the likeliest one by one other effect, without their nuisance parameters."""
    return _each_once([found.best, *(j for j in found.fits if len(j.explanation.effects) == 1)])[:HINTS]


def _each_once(ranked: Sequence[Fit]) -> list[Explanation]:
    """The first explanation of each set of effects, without its nuisance parameters; "no effect" is none of them."""
    once: dict[tuple[str, ...], Explanation] = {}
    for fit in ranked:
        if fit.explanation.effects:
            once.setdefault(tuple(sorted(fit.explanation.effects)), replace(fit.explanation, nuisance={}))
    return list(once.values())


def judge(found: Found, corrected: bool = False) -> Verdict:
    """The outcome: is there a gap, and does the best explanation leave anything?

    ``corrected`` tells that coefficients of the vehicle's file were corrected, so that there was a gap in any case.
    """
    explained = found.excess_as_stated < found.most_left
    if not found.best.explanation.effects and not corrected:
        return Verdict.NO_GAP if explained else Verdict.UNEXPLAINED
    return Verdict.EXPLAINED if explained else Verdict.PARTLY_EXPLAINED


def is_explained(found: Found) -> bool:
    """Whether a log has no gap, or one that effects explain."""
    return judge(found) in (Verdict.NO_GAP, Verdict.EXPLAINED)
