"""From a flight log to a diagnosis."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from threadpoolctl import threadpool_limits

from auv_torchrl.diagnosis.axes import examined, followable, restricted, steep_stretches
from auv_torchrl.diagnosis.calibrate.calibration import noise_findings
from auv_torchrl.diagnosis.calibrate.correction import Correction, correct_file
from auv_torchrl.diagnosis.calibrate.flights import floor_findings
from auv_torchrl.diagnosis.calibrate.healthy_flights import check_healthy_flight
from auv_torchrl.diagnosis.calibrate.parameters import Coefficient
from auv_torchrl.diagnosis.calibrate.vehicle_file import StoredCalibration
from auv_torchrl.diagnosis.configured import configured, said_too
from auv_torchrl.diagnosis.decision import decide
from auv_torchrl.diagnosis.doubt import (
    BELIEVED,
    bounded,
    closes_everywhere,
    doubted_alternatives,
    doubts,
    hedged,
    limited,
    said_first,
    unless_shared,
)
from auv_torchrl.diagnosis.headline import FILE_OFF, headline_of
from auv_torchrl.diagnosis.identify.detectable import detectable_sizes, hidden_members, with_more_flights
from auv_torchrl.diagnosis.identify.equivalence import indistinguishable
from auv_torchrl.diagnosis.identify.found import Found
from auv_torchrl.diagnosis.identify.hypotheses import Settings, apply_values, load_settings
from auv_torchrl.diagnosis.identify.posterior import SOMETHING_UNKNOWN, alternatives, effect_probabilities
from auv_torchrl.diagnosis.identify.search import Progress
from auv_torchrl.diagnosis.lengths import check_lengths, share_findings, split, spread, stretches_of
from auv_torchrl.diagnosis.localize.attribute import input_mappable
from auv_torchrl.diagnosis.localize.locate import locate
from auv_torchrl.diagnosis.localize.unlike import is_unlike, unless_unlike
from auv_torchrl.diagnosis.localize.wording import does_otherwise
from auv_torchrl.diagnosis.log_search import LogSearch, is_explained, judge, search_both_attitudes
from auv_torchrl.diagnosis.named import cannot_tell, found_effects
from auv_torchrl.diagnosis.next_experiment import choose_experiment
from auv_torchrl.diagnosis.noise import noise_finding, outlier_findings, quiet_findings
from auv_torchrl.diagnosis.overview import Overview
from auv_torchrl.diagnosis.summary import summarise
from auv_torchrl.diagnosis.unanswered.both_readings import weigh_readings
from auv_torchrl.diagnosis.validate.confirm import confirm, is_possible, not_confirmed
from auv_torchrl.diagnosis.validate.predict import (
    Predictions,
    closed_share,
    held_out_windows,
    measure_gap,
    predict_by,
    unforeseen,
    widened,
)
from auv_torchrl.diagnosis.validate.refute import take_back
from auv_torchrl.diagnosis.validate.veto import calibration_vetoed, falls_short, only, shortfalls, vetoes, worse
from auv_torchrl.diagnosis.verdict import Diagnosis, EffectProbability, Verdict
from auv_torchrl.diagnosis.volts import volts_findings
from auv_torchrl.effects.effect import changed
from auv_torchrl.flightlog import Finding, FlightLog
from auv_torchrl.text import printable
from auv_torchrl.vehicle import Vehicle

PIECES, PIECE_S = 4, 8.0  # of a log, and s: what one cause must explain before it is asked whether it explains all
UNKNOWN_WIDTH = 0.03  # of the excess, over which "explained" turns into "something else acts"


@threadpool_limits.wrap(limits=1)  # the arrays are small: a second thread only waits
def diagnose(
    log: FlightLog,
    vehicle: Vehicle,
    healthy: Sequence[FlightLog] = (),
    test: Sequence[FlightLog] = (),
    progress: Callable[[str, float], None] | None = None,
    vehicle_name: str = "",
    settings: Settings | None = None,
    uncertainty: Sequence[Coefficient] = (),
    kept: StoredCalibration | None = None,
) -> Diagnosis:
    """Tell where a vehicle differs from its simulator, by which effects, and how far they close the gap.

    Args:
        log: the flight to explain.
        vehicle: nominal vehicle, empty batch.
        healthy: logs of the same vehicle without the effect: they calibrate its coefficients and give the disturbance
            floor and the sensor noise; effects are then relative to the calibrated vehicle. Without one, the floor of
            the settings is assumed. The findings say which.
        test: logs on which before and after are compared; without one a part of ``log`` is held out.
        progress: called with what is done and the share of the work behind it.
        vehicle_name: for the report.
        settings: how to diagnose; None reads ``conf/diagnosis/default.yaml``.
        uncertainty: coefficients of the vehicle that are guesses: they are calibrated on the healthy logs, else on the
            log itself, before effects are searched for.
        kept: what the vehicle's file keeps of healthy logs; it stands for them where there are none.

    Raises:
        FlightLogError: if a log is too short for the settings, or has no axis that can be followed.
    """
    settings = settings or load_settings()
    report = progress or (lambda step, share: None)
    log, healthy = stretches_of(followable(log)), [stretches_of(check_healthy_flight(sound)) for sound in healthy]
    log = replace(log, findings=unless_shared(log.findings, healthy))
    test = [stretches_of(followable(unseen_log)) for unseen_log in test]

    def once(answering: FlightLog, begin: float, end: float) -> tuple[Diagnosis, Found]:
        unseen = [restricted(unseen_log, answering.axes) for unseen_log in test]
        given = Given(vehicle, tuple(healthy), settings, tuple(uncertainty), kept)
        return diagnose_answering(
            answering, unseen, given, lambda step, share: report(step, begin + (end - begin) * share), vehicle_name
        )

    found = weigh_readings(log, vehicle, settings, once)
    report("done", 1.0)
    return replace(found, headline=headline_of(found), overview=Overview.of(log))


# long: the stages of a diagnosis in their order, each a call, to be read in one place
def diagnose_answering(
    log: FlightLog, test: Sequence[FlightLog], given: "Given", report: Progress, vehicle_name: str
) -> tuple[Diagnosis, Found]:
    """The diagnosis of a log whose channels all follow the vehicle, and what was found by its search.

    Raises:
        FlightLogError: if the log is too short for the settings.
    """
    vehicle, settings, healthy = given.vehicle, given.settings, given.healthy
    training, testing, numbers = split(log, test)
    check_lengths(training, testing, healthy, len(numbers) == len(log.episodes), settings)
    corrected, explained = Correction(vehicle), None
    if given.uncertainty and not (healthy or given.kept):
        explained = one_cause(training, testing, given, report)
        corrected = correct_file(training, vehicle, given.uncertainty, settings) if explained is None else corrected
    explained = explained or explain(training, testing, given, corrected, report)
    if corrected.effects and (quantities := worse(explained.predictions, 0, 1)):
        corrected = Correction(vehicle, findings=(calibration_vetoed(quantities),))
        explained = explain(training, testing, given, corrected, report)
    searched, found, problem = explained.searched, explained.found, explained.found.problem
    predictions, vetoed = explained.predictions, explained.vetoed
    verdict = judge(found, corrected=bool(corrected.effects))
    closed = closed_share(predictions) if verdict is not Verdict.NO_GAP else None
    gap = measure_gap(predictions, numbers, closed)
    hedge = bool(corrected.effects) and not closes_everywhere(gap)
    short = verdict is Verdict.EXPLAINED and falls_short(predictions, closed)
    noise = (*quiet_findings(problem), *outlier_findings(problem), *steep_stretches(log), noise_finding(problem))
    findings = (
        *volts_findings(log, vehicle),
        *corrected.findings,
        *rests_on(searched),
        *vetoes(vetoed),
        *shortfalls(short),
        *share_findings(problem.windows, training),
        *noise,
    )
    doubted = doubts((*log.findings, *findings))
    partly = verdict is Verdict.EXPLAINED and (short or hedge)
    outcome = Verdict.PARTLY_EXPLAINED if partly else verdict  # where the log is right
    verdict = limited(outcome, doubted)
    from scipy.special import expit  # here: it takes long to import

    unknown = float(expit((found.excess_as_stated - found.most_left) / UNKNOWN_WIDTH))
    unknown = 1.0 if vetoed or partly else unknown
    probability = bounded(effect_probabilities(found, unknown), doubted)
    either = alternatives(found, unknown)
    either = doubted_alternatives(either, 1 - BELIEVED, FILE_OFF) if hedge else either
    either = doubted_alternatives(either, BELIEVED, "a fault of the log") if doubted else either
    effects = found_effects(problem, found, probability, closed, log.autopilot) if verdict is not Verdict.NO_GAP else ()
    corrections = hedged(corrected.effects) if hedge else corrected.effects
    effects = tuple(effect for effect in (*corrections, *effects) if effect.departs)
    findings = (*configured(log, healthy, verdict, effects), *findings)
    same, hidden = indistinguishable(problem, found), hidden_members(problem, found)
    report("confirming in MuJoCo", 0.95)
    confirmed = confirm(predictions, explained.vehicles) if effects and is_possible() else None
    if effects and confirmed is None:
        findings = (*findings, not_confirmed())
    gap = replace(gap, confirmed=confirmed)
    where = locate(problem, found, effects, verdict, searched.onset)
    if verdict is Verdict.UNEXPLAINED and (does := does_otherwise(where)):
        either = tuple(replace(one, besides=does) if one.besides == SOMETHING_UNKNOWN else one for one in either)
    summary = summarise(outcome, effects, where, gap, corrected.sentences, examined(problem))
    diagnosis = Diagnosis(
        log=printable(log.name),
        vehicle=printable(vehicle_name),
        verdict=verdict,
        summary=said_too(said_first(summary, verdict, doubted), findings, effects),
        where=where,
        effects=effects,
        candidates=tuple(EffectProbability(name, p) for name, p in probability.items()),
        indistinguishable=same,
        next_experiment=choose_experiment(problem, found, verdict, where),
        gap=gap,
        input_mappable=input_mappable(problem, found.follow),
        detectable=detectable_sizes(found.field, hidden) if verdict is Verdict.NO_GAP else {},
        detectable_with=with_more_flights(found.field, hidden) if verdict is Verdict.NO_GAP else {},
        cannot_tell=cannot_tell(problem, found, hidden),
        findings=findings,
        decision=decide(found, refuted=bool(vetoed)),
        alternatives=either,
        windows=held_out_windows(predictions, testing),
    )
    return diagnosis, found


@dataclass(frozen=True)
class Given:
    """What a log is explained by."""

    vehicle: Vehicle  # as its file says, empty batch
    healthy: tuple[FlightLog, ...]
    settings: Settings
    uncertainty: tuple[Coefficient, ...]
    kept: StoredCalibration | None


@dataclass(frozen=True)
class Explained:
    """What explains a log on top of one calibration of its vehicle, and how that predicts held-out flight."""

    searched: LogSearch
    found: Found  # without effects that predict held-out flight worse than no effect
    vehicles: tuple[Vehicle, Vehicle]  # as the file says, or as healthy logs do; and with all that was found
    predictions: Predictions  # of these two
    vetoed: tuple[str, ...]  # what the effects that were taken back predict worse


def explain(
    training: FlightLog, testing: FlightLog, given: Given, corrected: Correction, report: Progress
) -> Explained:
    """Look for effects on top of a calibration, and take them back where they predict held-out flight worse.

    Whether the calibration stands is not fit before: where it has taken up some of a fault, it predicts badly
    without the effect that was found beside it.
    """
    settings = corrected.settings(given.settings)
    searched = search_both_attitudes(
        training, corrected.vehicle, given.healthy, settings, report, given.uncertainty, given.kept,
        corrected.prior,
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
        return Explained(searched, replace(found, best=found.none), (before, base), predicted([before, base]), vetoed)
    return Explained(searched, found, (before, after), only(predictions, 0, 2), vetoed)


def one_cause(training: FlightLog, testing: FlightLog, given: Given, report: Progress) -> Explained | None:
    """One effect, none, or one thruster that explains a log with the file as it is; None where nothing does.

    A file that is off in many coefficients takes up a part of any fault, and no single cause explains what it does.
    """
    single = replace(given, settings=replace(given.settings, most_effects=1))
    if training.duration > 2 * PIECES * PIECE_S:  # a file that is off shows in a part, in a fraction of the time
        part = spread(training, PIECES, PIECE_S)
        short = search_both_attitudes(part, given.vehicle, (), single.settings, report).found
        if not (is_explained(short) or is_unlike(short, given.settings)):
            return None
    explained = explain(training, testing, single, Correction(given.vehicle), report)
    if not is_explained(explained.found):
        return explained if is_unlike(explained.found, given.settings) else None
    gap = measure_gap(explained.predictions, (), closed_share(explained.predictions))
    return explained if closes_everywhere(gap) else None


def rests_on(searched: LogSearch) -> tuple[Finding, ...]:
    """What the verdict rests on: a healthy log, or assumptions."""
    problem = searched.found.problem
    if searched.sound is None:
        return (
            *floor_findings(problem),
            *searched.contradiction,
            *searched.attitude,
        )
    return (*searched.sound.findings, *noise_findings(problem.noisier), *searched.attitude)
