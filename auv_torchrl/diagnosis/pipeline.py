"""From a flight log to a diagnosis."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from threadpoolctl import threadpool_limits

from auv_torchrl.diagnosis.axes import examined, followable, restricted, steep_stretches
from auv_torchrl.diagnosis.calibrate.parameters import Coefficient
from auv_torchrl.diagnosis.calibrate.vehicle_file import StoredCalibration
from auv_torchrl.diagnosis.conclude.conclusion import Causes, Conclusion, conclude, name_located, weigh_causes
from auv_torchrl.diagnosis.conclude.decision import cannot_tell, decide
from auv_torchrl.diagnosis.conclude.findings import (
    configured,
    noise_finding,
    outlier_findings,
    quiet_findings,
    volts_findings,
    with_configuration,
)
from auv_torchrl.diagnosis.conclude.summary import headline_of, summarise
from auv_torchrl.diagnosis.doubt import behind_doubts, unless_shared
from auv_torchrl.diagnosis.explain import Explained, Given, explain_log, rests_on
from auv_torchrl.diagnosis.identify.equivalence import indistinguishable
from auv_torchrl.diagnosis.identify.hypotheses import Settings, load_settings
from auv_torchrl.diagnosis.identify.posterior import detectable_sizes, hidden_members, with_more_flights
from auv_torchrl.diagnosis.identify.search import Found, Progress
from auv_torchrl.diagnosis.lengths import check_lengths, share_findings, split, stretches_of
from auv_torchrl.diagnosis.localize.attribute import input_mappable
from auv_torchrl.diagnosis.localize.locate import locate
from auv_torchrl.diagnosis.next_experiment import choose_experiment
from auv_torchrl.diagnosis.unanswered.both_readings import weigh_readings
from auv_torchrl.diagnosis.validate.confirm import confirm, is_possible, not_confirmed
from auv_torchrl.diagnosis.validate.healthy_flights import check_healthy_flight
from auv_torchrl.diagnosis.validate.predict import held_out_windows
from auv_torchrl.diagnosis.validate.veto import shortfalls, vetoes
from auv_torchrl.diagnosis.verdict import Diagnosis, EffectProbability, Overview, Verdict, Where
from auv_torchrl.flightlog import Finding, FlightLog
from auv_torchrl.text import printable
from auv_torchrl.vehicle import Vehicle


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
    given = Given(vehicle, tuple(healthy), settings, tuple(uncertainty), kept)

    def once(answering: FlightLog, begin: float, end: float, by: Given | None = None) -> tuple[Diagnosis, Found]:
        unseen = [restricted(unseen_log, answering.axes) for unseen_log in test]

        def part(step: str, share: float) -> None:
            report(step, begin + (end - begin) * share)

        return diagnose_answering(answering, unseen, by or given, part, vehicle_name)

    def unsearched() -> Diagnosis:
        bare = replace(given, healthy=(), uncertainty=(), settings=replace(settings, most_effects=0))
        unseen = [restricted(unseen_log, log.axes) for unseen_log in test]
        return diagnose_answering(log, unseen, bare, report, vehicle_name)[0]

    found = weigh_readings(log, given, once, unsearched)
    report("done", 1.0)
    return replace(found, headline=headline_of(found), overview=Overview.of(log))


def diagnose_answering(
    log: FlightLog, test: Sequence[FlightLog], given: Given, report: Progress, vehicle_name: str
) -> tuple[Diagnosis, Found]:
    """The diagnosis of a log whose channels all follow the vehicle, and what was found by its search.

    Raises:
        FlightLogError: if the log is too short for the settings.
    """
    training, testing, numbers = split(log, test)
    check_lengths(training, testing, given.healthy, len(numbers) == len(log.episodes), given.settings)
    explained = explain_log(training, testing, given, report)
    noticed = findings_on(log, given.vehicle, explained)
    concluded = conclude(explained, numbers, (*log.findings, *noticed))
    causes = weigh_causes(log, explained, concluded)
    problem, found = explained.found.problem, explained.found
    where = locate(problem, found, causes.effects, concluded.verdict, explained.searched.onset)
    if concluded.hedge:  # beside a file that may be off, nobody knows what one thruster gives of what it should
        where = replace(where, thrust_map=None, intermittence=None)
    causes = name_located(causes, where, concluded.verdict)
    report("confirming in MuJoCo", 0.95)
    confirmed = confirm(explained.predictions, explained.vehicles) if causes.effects and is_possible() else None
    findings = (
        *configured(log, given.healthy, concluded.verdict, causes.effects),
        *shortfalls(concluded.short),
        *noticed,
        *((not_confirmed(),) if causes.effects and confirmed is None else ()),
    )
    concluded = replace(concluded, gap=replace(concluded.gap, confirmed=confirmed))
    return state(log, vehicle_name, explained, concluded, causes, where, findings), found


def findings_on(log: FlightLog, vehicle: Vehicle, explained: Explained) -> tuple[Finding, ...]:
    """What was noticed in a log, and what its explanation rests on."""
    problem = explained.found.problem
    return (
        *volts_findings(log, vehicle),
        *explained.corrected.findings,
        *rests_on(explained.searched),
        *vetoes(explained.vetoed),
        *share_findings(problem.windows, explained.learnt),
        *quiet_findings(problem),
        *outlier_findings(problem, explained.found.best),
        *steep_stretches(log),
        noise_finding(problem),
    )


def state(
    log: FlightLog,
    vehicle_name: str,
    explained: Explained,
    concluded: Conclusion,
    causes: Causes,
    where: Where,
    findings: tuple[Finding, ...],
) -> Diagnosis:
    """All that is said about a log, of what was concluded."""
    found, problem, verdict = explained.found, explained.found.problem, concluded.verdict
    hidden, gapless = hidden_members(problem, found), verdict is Verdict.NO_GAP
    sentences = explained.corrected.sentences
    summary = summarise(concluded.if_sound, causes.effects, where, concluded.gap, sentences, examined(problem))
    return Diagnosis(
        log=printable(log.name),
        vehicle=printable(vehicle_name),
        verdict=verdict,
        summary=with_configuration(behind_doubts(summary, verdict, concluded.doubted), findings, causes.effects),
        where=where,
        effects=causes.effects,
        candidates=tuple(EffectProbability(name, p) for name, p in causes.probability.items()),
        indistinguishable=indistinguishable(problem, found),
        next_experiment=choose_experiment(problem, found, verdict, where),
        gap=concluded.gap,
        input_mappable=input_mappable(problem, found.follow),
        detectable=detectable_sizes(found.field, hidden) if gapless else {},
        detectable_with=with_more_flights(found.field, hidden) if gapless else {},
        cannot_tell=cannot_tell(problem, found, hidden),
        findings=findings,
        decision=decide(found, refuted=bool(explained.vetoed)),
        alternatives=causes.alternatives,
        windows=held_out_windows(explained.predictions, explained.held_out),
    )
