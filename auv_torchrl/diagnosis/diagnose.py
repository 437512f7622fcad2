"""From a flight log to a diagnosis."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import expit

from auv_torchrl.diagnosis.attitude import attitude_finding, hold_attitude, is_hidden, level_enough, log_likelihood
from auv_torchrl.diagnosis.axes import followable, restricted, unseen
from auv_torchrl.diagnosis.bench import Bench, Judged
from auv_torchrl.diagnosis.calibration import Calibration, calibrate, noise_findings, stated_floor
from auv_torchrl.diagnosis.coefficients import MODEL_ERROR, Z95, calibrate_coefficients
from auv_torchrl.diagnosis.confirm import confirm
from auv_torchrl.diagnosis.detectable import detectable_sizes
from auv_torchrl.diagnosis.equivalence import indistinguishable
from auv_torchrl.diagnosis.explanation import Explanation
from auv_torchrl.diagnosis.how_far import closed_share, held_out_windows, measure_gap, predict
from auv_torchrl.diagnosis.hypotheses import Settings, apply_values, load_settings
from auv_torchrl.diagnosis.mappable import input_mappable
from auv_torchrl.diagnosis.next_experiment import choose_experiment
from auv_torchrl.diagnosis.noise import noise_finding
from auv_torchrl.diagnosis.onset import Onset, find_onset, is_absent
from auv_torchrl.diagnosis.posterior import effect_probabilities
from auv_torchrl.diagnosis.search import Found, Progress, search
from auv_torchrl.diagnosis.summary import summarise
from auv_torchrl.diagnosis.uncertainty import Coefficient
from auv_torchrl.diagnosis.verdict import Candidate, Diagnosis, Estimate, FoundEffect, Verdict
from auv_torchrl.diagnosis.veto import is_worse, only
from auv_torchrl.diagnosis.where import locate
from auv_torchrl.diagnosis.windows import cut_windows
from auv_torchrl.effects import EFFECTS
from auv_torchrl.effects.effect import changed
from auv_torchrl.flightlog import Finding, FlightLog, Severity, join
from auv_torchrl.vehicle import Vehicle

UNKNOWN_WIDTH = 0.03  # of the excess, over which "explained" turns into "something else acts"
SIMPLE = 2  # values that explain a log wholly with a level vehicle: tilts, which bend everything, then play no part
HINTS = 2  # explanations of a level vehicle that are tried on one that may tilt


def diagnose(
    log: FlightLog,
    vehicle: Vehicle,
    healthy: Sequence[FlightLog] = (),
    test: Sequence[FlightLog] = (),
    progress: Callable[[str, float], None] | None = None,
    vehicle_name: str = "",
    settings: Settings | None = None,
    uncertainty: Sequence[Coefficient] = (),
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
            log itself, before effects are looked for.

    Raises:
        FlightLogError: if the log holds no window to look at, or no axis that can be followed.
    """
    settings = settings or load_settings()
    report = progress or (lambda step, share: None)
    log, healthy = followable(log), [followable(sound) for sound in healthy]
    test = [restricted(followable(unseen_log), log.axes) for unseen_log in test]
    training, testing, numbers = split(log, test)
    corrected = calibrate_coefficients(join(healthy or [training]), vehicle, uncertainty, settings)
    searched = settings if healthy else corrected.settings(settings)
    looked = look_both_ways(training, corrected.vehicle, healthy, searched, report)
    bench, found, own = looked.bench, looked.found, looked.bench.vehicle
    before = changed(vehicle, free=own.free)
    base = changed(corrected.vehicle, free=own.free)
    after = apply_values(own, found.best.explanation.values(own))
    stages = [before, base, after] if corrected.effects else [before, after]
    predictions = predict(testing, stages, settings, bench.sigma, 4 * bench.floor)
    if vetoed := bool(found.best.explanation.effects) and is_worse(predictions, len(stages) - 2, len(stages) - 1):
        found, after = replace(found, best=found.none), base
    predictions = only(predictions, 0, len(stages) - 1 - vetoed)
    if corrected.effects and is_worse(predictions, 0, 1):
        stands = diagnose(log, vehicle, healthy, test, progress, vehicle_name, settings)
        return replace(stands, findings=(*stands.findings, calibration_vetoed()))
    verdict = judge(bench, found, corrected=bool(corrected.effects))
    closed = closed_share(predictions) if verdict is not Verdict.NO_GAP else None
    unknown = float(expit((excess(found) - settings.excess) / UNKNOWN_WIDTH))
    probability = effect_probabilities(bench, found, 1.0 if vetoed else unknown)
    effects = found_effects(bench, found, probability, closed) if verdict is not Verdict.NO_GAP else ()
    effects = (*corrected.effects, *effects)
    same = indistinguishable(bench, found)
    report("confirming in MuJoCo", 0.95)
    confirmed = confirm(predictions, [before, after]) if effects else None
    gap = replace(measure_gap(predictions, numbers, closed), confirmed=confirmed)
    where = locate(bench, found, effects, verdict, looked.onset)
    report("done", 1.0)
    return Diagnosis(
        log=log.name,
        vehicle=vehicle_name,
        verdict=verdict,
        summary=summarise(verdict, effects, where, gap, corrected.sentences),
        where=where,
        effects=effects,
        candidates=tuple(Candidate(name, p) for name, p in probability.items()),
        indistinguishable=same,
        next_experiment=choose_experiment(bench, found, verdict, where),
        gap=gap,
        input_mappable=input_mappable(bench, found.follow),
        detectable=detectable_sizes(found.field) if verdict is Verdict.NO_GAP else {},
        cannot_tell=cannot_tell(bench, found),
        findings=(*log.findings, *corrected.findings, *rests_on(looked), *vetoes(vetoed), noise_finding(bench)),
        windows=held_out_windows(predictions, testing),
    )


@dataclass(frozen=True)
class Looked:
    """A log explained under one assumption about the attitude."""

    bench: Bench
    found: Found
    sound: Calibration | None
    onset: Onset | None = None  # what is explained are the windows behind it
    attitude: tuple[Finding, ...] = ()


def look(
    training: FlightLog,
    vehicle: Vehicle,
    healthy: Sequence[FlightLog],
    settings: Settings,
    report: Progress,
    seen: Looked | None = None,
) -> Looked:
    """Calibrate a vehicle on the healthy logs and explain a log with it.

    ``seen`` is what a vehicle with another attitude showed: its explanations are tried too, on the same windows.
    """
    sound = calibrate(healthy, vehicle, settings) if healthy else None
    own, known = (sound.vehicle, sound.known) if sound else (vehicle, None)
    bench = Bench(cut_windows(training, settings.window_s, settings.lead_s, settings.bin_s), own, settings, known)
    hints = best_singles(seen.found) if seen else ()
    follow = bench.follow()
    report("following the log", 0.2)
    onset = seen.onset if seen else find_onset(bench, follow)
    if onset is not None:
        behind = Bench(bench.windows.subset(onset.behind), own, settings, known)
        found = search(behind, behind.follow(), report, hints)
        if seen or is_absent(bench, onset, found.best.explanation, own, settings):
            return Looked(behind, found, sound, onset)
    return Looked(bench, search(bench, follow, report, hints), sound)


def look_both_ways(
    training: FlightLog, vehicle: Vehicle, healthy: Sequence[FlightLog], settings: Settings, report: Progress
) -> Looked:
    """Explain a log; where it hides roll and pitch and shows a gap, with a level and with a free vehicle."""
    level = look(training, hold_attitude(training, vehicle), healthy, settings, report)
    best = level.found.best
    if not is_hidden(training, vehicle) or judge(level.bench, level.found) is Verdict.NO_GAP:
        return level
    if best.nothing_left and len(best.explanation.knobs) <= SIMPLE:
        return replace(level, attitude=(level_enough(),))
    free = look(training, vehicle, healthy, settings, report, level)
    odds = log_likelihood(free.bench, free.found.best) - log_likelihood(level.bench, level.found.best)
    better = free if odds > 0 else level
    return replace(better, attitude=(attitude_finding(odds > 0, abs(odds)),))


def best_singles(found: Found) -> list[Explanation]:
    """The likeliest explanations by one effect each, without their slack."""
    singles = {
        j.explanation.effects: j.explanation for j in reversed(found.polished) if len(j.explanation.effects) == 1
    }
    return [replace(explanation, slack={}) for explanation in [*singles.values()][::-1][:HINTS]]


def split(log: FlightLog, test: Sequence[FlightLog]) -> tuple[FlightLog, FlightLog, tuple[int, ...]]:
    """What to learn from, what to test on, and the numbers of the held-out episodes."""
    if test:
        return log, join(test), ()
    if len(log.episodes) >= 3:
        last = log.episodes[-1].number
        return log.only(e.number for e in log.episodes[:-1]), log.only([last]), (last,)
    cut = [int(0.8 * len(episode)) for episode in log.episodes]
    early = replace(log, episodes=tuple(e.rows(0, k) for e, k in zip(log.episodes, cut, strict=True)))
    late = replace(log, episodes=tuple(e.rows(k, len(e)) for e, k in zip(log.episodes, cut, strict=True)))
    return early, late, tuple(e.number for e in log.episodes)


def rests_on(looked: Looked) -> tuple[Finding, ...]:
    """What the verdict rests on: a healthy log, or assumptions."""
    if looked.sound is None:
        return (stated_floor(looked.bench.settings, looked.bench.layout.dof), *looked.attitude)
    return (*looked.sound.findings, *noise_findings(looked.bench.noisier), *looked.attitude)


def excess(found: Found) -> float:
    """Chi-square per measured number that the best explanation leaves; 1 is noise alone."""
    return found.best.chi2 / found.best.quadratic.numbers


def calibration_vetoed() -> Finding:
    """What is said where corrected coefficients do not carry over to held-out flight."""
    sentence = (
        "coefficients corrected on this log predict held-out flight worse than the vehicle's file: the file stands"
    )
    remedy = "Give logs that command what the held-out flight commands, above all in size"
    return Finding(Severity.WARNING, "calibration_vetoed", sentence, remedy)


def vetoes(vetoed: bool) -> tuple[Finding, ...]:
    """What was thrown away because held-out flight speaks against it."""
    if not vetoed:
        return ()
    sentence = "the effects that fit this log best predict held-out flight worse than without them: none is named"
    return (Finding(Severity.WARNING, "vetoed", sentence, "Give a longer log, or one that moves in more ways"),)


def judge(bench: Bench, found: Found, corrected: bool = False) -> Verdict:
    """The outcome: is there a gap, and does the best explanation leave anything?

    ``corrected`` tells that coefficients of the vehicle's file were corrected, so that there was a gap in any case.
    """
    explained = excess(found) < bench.settings.excess
    if not found.best.explanation.effects and not corrected:
        return Verdict.NO_GAP if explained else Verdict.UNEXPLAINED
    return Verdict.EXPLAINED if explained else Verdict.PARTLY_EXPLAINED


def found_effects(
    bench: Bench, found: Found, probability: dict[str, float], closed: float | None
) -> tuple[FoundEffect, ...]:
    """The effects of the best explanation with values, intervals and shares, the one that closes most first."""
    best = found.best
    deviation = np.sqrt(np.diag(best.covariance))
    spread = {knob.key: float(d) for knob, d in zip(best.explanation.fitted, deviation, strict=True)}
    shares = leave_one_out(found)
    effects = [
        _found_effect(bench, best, name, spread, probability[name], (closed or 0.0) * shares[name])
        for name in best.explanation.effects
    ]
    return tuple(sorted(effects, key=lambda effect: -(effect.gap_closed or 0.0)))


def leave_one_out(found: Found) -> dict[str, float]:
    """Share of what the explanation closes that comes back when one effect is taken out."""
    best = found.best
    nothing = max(found.none.chi2, best.chi2 + 1e-9)
    shares = {}
    for name in best.explanation.effects:
        rest = set(best.explanation.effects) - {name}
        others = [j.chi2 for j in found.polished if set(j.explanation.effects) == rest]
        worse = min(others, default=nothing)
        shares[name] = float(np.clip((worse - best.chi2) / (nothing - best.chi2), 0.0, 1.0))
    return shares


def cannot_tell(bench: Bench, found: Found) -> tuple[str, ...]:
    """What this log is silent about: effects without a mark, and values at a bound."""
    seen = {bench.atoms[i].effect for i in np.flatnonzero(found.field.seen)}
    blind = sorted({atom.effect for atom in bench.atoms} - seen)
    sentences = [*unseen(bench), *(f"{name} would leave no mark on this log" for name in blind)]
    for knob in found.best.explanation.fitted:
        p = EFFECTS[knob.effect].member_parameters(bench.vehicle)[knob.members[0]]
        nominal = EFFECTS[knob.effect].nominal(bench.vehicle)[knob.members[0]]
        if knob.value in (p.low, p.high) and knob.value != nominal:
            sentences.append(f"{knob.effect}: {', '.join(knob.members)} is at its bound {knob.value:g} {p.unit}")
    return tuple(sentences)


def _found_effect(
    bench: Bench, best: Judged, name: str, spread: dict[tuple, float], probability: float, closed: float
) -> FoundEffect:
    effect = EFFECTS[name]
    declared, nominal = effect.member_parameters(bench.vehicle), effect.nominal(bench.vehicle)
    parameters: dict[str, Estimate] = {}
    thrusters: set[int] = set()
    sentences = []
    for knob in best.explanation.knobs:
        if knob.effect != name:
            continue
        for member in knob.members:
            p = declared[member]
            model = 0.0 if knob.discrete else MODEL_ERROR * abs(knob.value - nominal[member])
            half = Z95 * float(np.hypot(spread.get(knob.key, 0.0), model))
            low, high = max(p.low, knob.value - half), min(p.high, knob.value + half)
            parameters[member] = Estimate(knob.value, low, high, nominal[member], p.unit)
            which = member.removeprefix(f"{p.name}_")
            sentences.append(p.sentence.format(value=knob.value, which=which))
            if p.over == "thruster":
                thrusters.add(int(which))
    if len(knob_members := {k.members for k in best.explanation.knobs if k.effect == name}) == 1:
        (members,) = knob_members
        if len(members) > 1:
            p = declared[members[0]]
            which = f"s 1 to {len(members)}" if p.over == "thruster" else "all directions"
            sentences = [p.sentence.format(value=parameters[members[0]].value, which=which)]
    return FoundEffect(name, probability, parameters, tuple(sorted(thrusters)), closed, "; ".join(sentences))
