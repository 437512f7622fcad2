"""From a flight log to a diagnosis."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import torch

from auv_torchrl.diagnosis.bench import Bench, Judged
from auv_torchrl.diagnosis.how_far import closed_share, held_out_windows, measure_gap, predict
from auv_torchrl.diagnosis.hypotheses import Settings, apply_values, load_settings
from auv_torchrl.diagnosis.posterior import effect_probabilities
from auv_torchrl.diagnosis.search import Found, search
from auv_torchrl.diagnosis.verdict import Candidate, Diagnosis, Estimate, FoundEffect, Verdict
from auv_torchrl.diagnosis.where import locate
from auv_torchrl.diagnosis.windows import cut_windows
from auv_torchrl.effects import EFFECTS
from auv_torchrl.effects.effect import changed
from auv_torchrl.flightlog import FlightLog, join
from auv_torchrl.vehicle import Vehicle

Z95 = 1.96
SMALL_SWING = 0.05  # rad of roll and pitch below which they are taken as held


def diagnose(
    log: FlightLog,
    vehicle: Vehicle,
    healthy: Sequence[FlightLog] = (),
    test: Sequence[FlightLog] = (),
    progress: Callable[[str, float], None] | None = None,
    vehicle_name: str = "",
    settings: Settings | None = None,
) -> Diagnosis:
    """Tell where a vehicle differs from its simulator, by which effects, and how far they close the gap.

    Args:
        log: the flight to explain.
        vehicle: nominal vehicle, empty batch.
        healthy: logs of the same vehicle without the effect: they give the disturbance floor.
        test: logs on which before and after are compared; without one a part of ``log`` is held out.
        progress: called with what is done and the share of the work behind it.
        vehicle_name: for the report.
        settings: how to diagnose; None reads ``conf/diagnosis/default.yaml``.

    Raises:
        ValueError: if the log holds no window to look at.
    """
    settings = settings or load_settings()
    report = progress or (lambda step, share: None)
    held = hold_attitude(log, vehicle)
    training, testing, numbers = split(log, test)
    bench = Bench(cut_windows(training, settings.window_s, settings.lead_s), held, settings)
    found = search(bench, report)
    after = apply_values(held, found.best.explanation.values(held))
    predictions = predict(testing, [held, after], settings, bench.sigma, 4 * bench.floor)
    closed = closed_share(predictions)
    verdict = judge(bench, found)
    unknown = 1.0 if verdict in (Verdict.PARTLY_EXPLAINED, Verdict.UNEXPLAINED) else 0.0
    probability = effect_probabilities(bench, found, unknown)
    effects = found_effects(bench, found, probability) if verdict is not Verdict.NO_GAP else ()
    return Diagnosis(
        log=log.name,
        vehicle=vehicle_name,
        verdict=verdict,
        summary=summarise(verdict, effects),
        where=locate(bench, found.follow, found.best),
        effects=effects,
        candidates=tuple(Candidate(name, p) for name, p in probability.items()),
        indistinguishable=(),
        next_experiment=None,
        gap=measure_gap(predictions, numbers, closed),
        input_mappable=None,
        findings=log.findings,
        windows=held_out_windows(predictions, testing),
    )


def hold_attitude(log: FlightLog, vehicle: Vehicle) -> Vehicle:
    """The vehicle with roll and pitch held where the log does not show them move."""
    swings = []
    for axis, column in (("roll", 3), ("pitch", 4)):
        if axis in log.axes:
            swings += [np.ptp(episode.pose[:, column]) for episode in log.episodes]
    if swings and max(swings) > SMALL_SWING:
        return vehicle
    free = torch.tensor([1.0, 1.0, 1.0, 0.0, 0.0, 1.0], dtype=vehicle.free.dtype)
    return changed(vehicle, free=vehicle.free * free)


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


def judge(bench: Bench, found: Found) -> Verdict:
    """The outcome: is there a gap, and does the best explanation leave anything?"""
    excess = found.best.chi2 / found.best.quadratic.numbers
    explained = excess < bench.settings.excess
    if not found.best.explanation.effects:
        return Verdict.NO_GAP if explained else Verdict.UNEXPLAINED
    return Verdict.EXPLAINED if explained else Verdict.PARTLY_EXPLAINED


def found_effects(bench: Bench, found: Found, probability: dict[str, float]) -> tuple[FoundEffect, ...]:
    """The effects of the best explanation with their values and intervals."""
    best = found.best
    deviation = np.sqrt(np.diag(best.covariance))
    spread = {knob.key: float(d) for knob, d in zip(best.explanation.fitted, deviation, strict=True)}
    return tuple(_found_effect(bench, best, effect, spread, probability[effect]) for effect in best.explanation.effects)


def _found_effect(bench: Bench, best: Judged, name: str, spread: dict[tuple, float], probability: float) -> FoundEffect:
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
            half = Z95 * spread.get(knob.key, 0.0)
            low, high = max(p.low, knob.value - half), min(p.high, knob.value + half)
            parameters[member] = Estimate(knob.value, low, high, nominal[member], p.unit)
            which = member.removeprefix(f"{p.name}_")
            sentences.append(p.sentence.format(value=knob.value, which=which))
            if p.over == "thruster":
                thrusters.add(int(which))
    return FoundEffect(name, probability, parameters, tuple(sorted(thrusters)), None, "; ".join(sentences))


def summarise(verdict: Verdict, effects: tuple[FoundEffect, ...]) -> str:
    """One sentence for a pilot."""
    if not effects:
        return verdict.value
    sentence = "; ".join(effect.sentence for effect in effects)
    return sentence[0].upper() + sentence[1:] + "."
