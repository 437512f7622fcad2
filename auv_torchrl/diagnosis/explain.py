"""What explains a log: a correction of the vehicle's file, effects on top of it, checked on held-out flight."""

from dataclasses import dataclass, field, replace

from auv_torchrl.diagnosis.calibrate.calibration import noise_findings
from auv_torchrl.diagnosis.calibrate.correction import Correction, correct_file
from auv_torchrl.diagnosis.calibrate.flights import floor_findings
from auv_torchrl.diagnosis.calibrate.parameters import Coefficient
from auv_torchrl.diagnosis.calibrate.vehicle_file import StoredCalibration
from auv_torchrl.diagnosis.doubt import closes_everywhere
from auv_torchrl.diagnosis.identify.hypotheses import Settings, apply_values
from auv_torchrl.diagnosis.identify.search import Found, Progress
from auv_torchrl.diagnosis.localize.unlike import is_unlike, unless_unlike
from auv_torchrl.diagnosis.log_search import (
    Calibrated,
    LogSearch,
    is_explained,
    is_long,
    search_both_attitudes,
    search_pieces,
)
from auv_torchrl.diagnosis.validate.predict import (
    Predictions,
    closed_share,
    measure_gap,
    predict_by,
    unforeseen,
    widened,
)
from auv_torchrl.diagnosis.validate.veto import calibration_vetoed, only, take_back, worse
from auv_torchrl.effects.effect import changed
from auv_torchrl.flightlog import Finding, FlightLog
from auv_torchrl.vehicle import Vehicle


@dataclass(frozen=True)
class Given:
    """What a log is explained by."""

    vehicle: Vehicle  # as its file says, empty batch
    healthy: tuple[FlightLog, ...]
    settings: Settings
    uncertainty: tuple[Coefficient, ...]
    kept: StoredCalibration | None
    calibrated: Calibrated = field(default_factory=dict)  # what the healthy flights showed, for all parts of the log

    @property
    def is_guess(self) -> bool:
        """Whether the vehicle's file is a guess, and nothing but the log itself can correct it."""
        return bool(self.uncertainty) and not (self.healthy or self.kept)


@dataclass(frozen=True)
class Explained:
    """What explains a log on top of one correction of its vehicle, and how that predicts held-out flight."""

    learnt: FlightLog  # the flight that was searched
    held_out: FlightLog  # the flight that was predicted
    corrected: Correction
    searched: LogSearch
    found: Found  # without effects that predict held-out flight worse than no effect
    vehicles: tuple[Vehicle, Vehicle]  # as the file says, or as healthy logs do; and with all that was found
    predictions: Predictions  # of these two
    vetoed: tuple[str, ...]  # what the effects that were taken back predict worse


def explain_log(training: FlightLog, testing: FlightLog, given: Given, report: Progress) -> Explained:
    """What explains a log; where its file is a guess and no healthy flight is given, the file is corrected on the log.

    One cause that explains the log with the file as it is comes before a correction, and a correction that predicts
    held-out flight worse is taken back.
    """
    vehicle = given.vehicle
    if given.is_guess and (explained := one_cause(training, testing, given, report)) is not None:
        return explained
    settings = given.settings
    corrected = correct_file(training, vehicle, given.uncertainty, settings) if given.is_guess else Correction(vehicle)
    explained = explain(training, testing, given, corrected, report)
    if corrected.effects and (quantities := worse(explained.predictions, 0, 1)):
        corrected = Correction(vehicle, findings=(calibration_vetoed(quantities),))
        return explain(training, testing, given, corrected, report)
    return explained


def explain(
    training: FlightLog, testing: FlightLog, given: Given, corrected: Correction, report: Progress
) -> Explained:
    """Look for effects on top of a correction, and take them back where they predict held-out flight worse.

    Whether the correction stands is not fit before: where it has taken up some of a fault, it predicts badly
    without the effect that was found beside it.
    """
    settings = corrected.settings(given.settings)
    searched = search_both_attitudes(
        training, corrected.vehicle, given.healthy, settings, report, given.uncertainty, given.kept,
        corrected.prior, given.calibrated,
    )  # fmt: skip
    found, own = searched.found, searched.found.problem.vehicle
    unlike = None if is_explained(found) else unless_unlike(found)
    found = unlike or take_back(found, testing, given.settings)
    sound = searched.sound.vehicle if searched.sound else None  # only what is new since then is a gap
    before = changed(given.vehicle if sound is None else sound, free=own.free)
    base = changed(corrected.vehicle if sound is None else sound, free=own.free)
    after = apply_values(own, found.best.explanation.values(own))
    unseen = unforeseen(given.healthy, searched.sound, given.settings)

    def predicted(vehicles: list[Vehicle]) -> Predictions:
        return widened(predict_by(found.problem, testing, vehicles, given.settings), unseen)

    predictions = predicted([before, base, after])
    vetoed = worse(predictions, 1, 2) if found.best.explanation.effects else ()
    if vetoed:  # and from starts that have nothing of what is taken back
        found, after, predictions = replace(found, best=found.none), base, predicted([before, base])
    else:
        predictions = only(predictions, 0, 2)
    return Explained(training, testing, corrected, searched, found, (before, after), predictions, vetoed)


def is_explained_in_part(log: FlightLog, given: Given, may_be_faulty: bool) -> bool:
    """Whether some pieces of a log are explained with its file corrected on all of it, by effects if it may be faulty.

    Raises:
        FlightLogError: if the pieces are too short for the settings.
    """
    corrected = correct_file(log, given.vehicle, given.uncertainty, given.settings)
    settings = corrected.settings(given.settings if may_be_faulty else replace(given.settings, most_effects=0))
    searched = search_pieces(log, corrected.vehicle, settings, lambda step, share: None, corrected.prior)
    return is_explained(searched.found)


def one_cause(training: FlightLog, testing: FlightLog, given: Given, report: Progress) -> Explained | None:
    """One effect, none, or one thruster that explains a log with the file as it is; None where nothing does.

    A file that is off in many coefficients takes up a part of any fault, and no single cause explains what it does. An
    effect that does not explain pieces of a log does not explain all of it; a thruster that is sound for a while may.
    """
    none, one = (replace(given.settings, most_effects=number) for number in (0, 1))
    if is_long(training) and not (
        _may_explain(search_pieces(training, given.vehicle, one, report))
        or _may_explain(search_both_attitudes(training, given.vehicle, (), none, report))
    ):
        return None
    single = replace(given, settings=one)
    explained = explain(training, testing, single, Correction(given.vehicle), report)
    if not is_explained(explained.found):
        return explained if is_unlike(explained.found) else None
    if not explained.found.best.explanation.effects:
        return explained  # the file leaves noise, and noise corrects no file
    gap = measure_gap(explained.predictions, (), closed_share(explained.predictions))
    return explained if closes_everywhere(gap) else None


def _may_explain(searched: LogSearch) -> bool:
    """Whether one cause explains what was searched."""
    return is_explained(searched.found) or is_unlike(searched.found)


def rests_on(searched: LogSearch) -> tuple[Finding, ...]:
    """What an explanation rests on: a healthy log, or assumptions."""
    problem = searched.found.problem
    if searched.sound is None:
        return (*floor_findings(problem), *searched.contradiction, *searched.attitude)
    return (*searched.sound.findings, *noise_findings(problem.noisier), *searched.attitude)
