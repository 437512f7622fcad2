"""What is said of a log beside effects: noise, outliers, volts, and the parameters of the autopilot.

Noise widens the floor of every prediction and closes no gap. So white noise is measured beside the explanation, from
what is left when a free force follows everything slower, and not weighed against it.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.identify.paths import Fit
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.motion.smooth import noise_per_sample
from auv_torchrl.diagnosis.thresholds import OUTLIER
from auv_torchrl.diagnosis.verdict import Diagnosis, FoundEffect, Verdict
from auv_torchrl.effects import EFFECTS
from auv_torchrl.flightlog import Finding, FlightLog, Severity
from auv_torchrl.flightlog.log import ANGLES
from auv_torchrl.flightlog.streams.configuration import SHOWN_BY_FLIGHT, compare_configuration, to_set
from auv_torchrl.flightlog.streams.parameters import known
from auv_torchrl.physics.thrusters import VOLTS_EXPONENT, VOLTS_WITHIN
from auv_torchrl.quantities import percent
from auv_torchrl.vehicle import Vehicle

STATED = 1.3  # times the noise that the vehicle file states, from which the sensors are worse than that
LEAST_BELIEVED = 1e-5  # m, rad, m/s, rad/s, m/s^2: a hundredth of what the best sensors of this kind scatter by
OUTLYING = 3e-4  # share of the samples from which outliers are worth a word; noise makes one in a million
UNITS = {"x": "m", "y": "m", "z": "m", "roll": "rad", "pitch": "rad", "yaw": "rad", "u": "m/s", "v": "m/s", "w": "m/s",
         "p": "rad/s", "q": "rad/s", "r": "rad/s", "ax": "m/s^2", "ay": "m/s^2", "az": "m/s^2"}  # fmt: skip


def noise_finding(problem: Problem) -> Finding:
    """The noise of each channel, a warning where the vehicle states less, with the effect that reproduces it."""
    sizes = ", ".join(f"{name} {size:.2g} {UNITS[name]}" for name, size in problem.sigma.items())
    values = measured_noise(problem.sigma)
    stated = {"position": float(problem.vehicle.position_noise), "attitude": float(problem.vehicle.attitude_noise)}
    worse = [name for name, value in values.items() if 0 < STATED * stated[name] < value]
    simulate = ", ".join(f"{name}: {value:.2g}" for name, value in values.items())
    effect = next(effect.name for effect in EFFECTS.values() if effect.trial.is_noise)
    remedy = f"To simulate it, add the effect {effect}: {{{simulate}}}" if values else ""
    if not worse:
        sentence = f"white noise of the sensors, the floor of all predictions: {sizes}"
        return Finding(Severity.INFO, effect, sentence, remedy)
    sentence = f"the sensors are noisier than the vehicle states ({', '.join(worse)}): {sizes}"
    return Finding(Severity.WARNING, effect, sentence, remedy)


def quiet_findings(problem: Problem) -> tuple[Finding, ...]:
    """A doubt about channels with next to no noise: they are no measurement, or not only one."""
    quiet = tuple(name for name, size in problem.sigma.items() if size < LEAST_BELIEVED)
    if not quiet:
        return ()
    sentence = f"{', '.join(quiet)} have next to no noise: they were simulated, filtered or made up, not measured"
    return (Finding(Severity.WARNING, "no_noise", sentence, "Log what the sensors say", quiet, limits=True),)


def outlier_findings(problem: Problem, best: Fit) -> tuple[Finding, ...]:
    """A warning about samples that count less because no slow force, nor what explains the log, could have made them.

    A vehicle that tumbles turns faster than a slow force lets the nominal one turn: its samples are sound.
    """
    windows, outlying = problem.windows, problem.outlying
    lowered = np.divide(windows.trust, problem.given.trust, out=np.ones(outlying.shape), where=outlying)
    far = np.abs(best.path.state.residual) / noise_per_sample(windows, problem.sigma)
    off = outlying & ~(far.reshape(outlying.shape) < OUTLIER * lowered)
    counts = {name: int(count) for name, count in zip(windows.channels, off.sum((0, 1)), strict=True) if count}
    if sum(counts.values()) < OUTLYING * windows.numbers:
        return ()
    named = ", ".join(f"{count} of {name}" for name, count in counts.items())
    sentence = f"some values lie off every path that forces could have made ({named}); they count less"
    return (Finding(Severity.WARNING, "outliers", sentence, "Check the sensor", tuple(counts)),)


def measured_noise(sigma: dict[str, float]) -> dict[str, float]:
    """Parameters of the effect of noise from the noise of the channels of a pose."""
    groups = {"position": [sigma[a] for a in "xyz" if a in sigma], "attitude": [sigma[a] for a in ANGLES if a in sigma]}
    return {name: float(np.sqrt(np.mean(np.square(sizes)))) for name, sizes in groups.items() if sizes}


FELL = 0.03  # of the volts, from which thrust fades by more than the nuisance parameters of a sound vehicle


def volts_findings(log: FlightLog, vehicle: Vehicle) -> tuple[Finding, ...]:
    """How far logged volts explain a fading thrust, or that nothing says at which volts the file's thrusts hold."""
    logged = [episode.battery[np.isfinite(episode.battery)] for episode in log.episodes if episode.battery is not None]
    volts = np.concatenate([*logged, np.empty(0)])
    if not len(volts):
        return ()
    high, low, own = float(np.quantile(volts, 0.95)), float(np.quantile(volts, 0.05)), float(vehicle.volts)
    if not own:
        if high <= 0 or low > (1 - FELL) * high:
            return ()
        sentence = (
            f"the battery goes from {high:.1f} to {low:.1f} V, and the vehicle file does not say at which volts its"
        )
        remedy = "Enter volts under thrusters in the vehicle file, 16.0 for the published thrusts of a T200"
        return (
            Finding(Severity.INFO, "volts_unused", f"{sentence} thrusts hold: thrust is taken not to follow", remedy),
        )
    if not VOLTS_WITHIN[0] * own < low <= high < VOLTS_WITHIN[1] * own:
        sentence = f"the logged volts, {low:.1f} to {high:.1f}, are no battery of thrusters for {own:g} V"
        remedy = "Look at the scale of the power sensor (BATT_VOLT_MULT)"
        return (Finding(Severity.WARNING, "odd_volts", f"{sentence}: thrust does not follow those far off", remedy),)
    most, least = (percent((v / own) ** VOLTS_EXPONENT) for v in (high, low))
    sentence = f"thrust follows the logged volts, {high:.1f} to {low:.1f} V: {most} to {least} of the file's"
    return (Finding(Severity.INFO, "volts", f"{sentence}, which hold at {own:g} V"),)


def configured(
    log: FlightLog, healthy: Sequence[FlightLog], verdict: Verdict, effects: Iterable[FoundEffect]
) -> Iterator[Finding]:
    """The findings of the log, and what is set otherwise than in the healthy flights.

    Where a flight is understood, and shows that a motor turns as it should although its direction or its output was
    changed, wires or plugs were changed, too: nothing is to be set back then.
    """
    advised = _advised(effects)
    understood = verdict in (Verdict.NO_GAP, Verdict.EXPLAINED)
    for finding in (*log.findings, *compare_configuration(log.autopilot, [sound.autopilot for sound in healthy])):
        if finding.code in SHOWN_BY_FLIGHT and understood and not _covered(finding, advised):
            fits = f"{finding.sentence}; the motors push as they should, so that wires or plugs were changed, too"
            yield replace(finding, severity=Severity.INFO, sentence=fits, remedy="", param=())
        else:
            yield finding


def with_configuration(summary: str, findings: Iterable[Finding], effects: Iterable[FoundEffect]) -> str:
    """The summary, and the faults of the configuration that it does not tell of."""
    if not (faults := set_wrong(findings, effects)):
        return summary
    return f"{summary} Set wrong, say the parameters: {'; '.join(dict.fromkeys(f.sentence for f in faults))}."


def set_wrong(findings: Iterable[Finding], effects: Iterable[FoundEffect]) -> tuple[Finding, ...]:
    """The findings whose remedy is a parameter, but for those that the advice about an effect tells, too."""
    advised = _advised(effects)
    return tuple(f for f in findings if f.param and not _covered(f, advised))


def to_change(diagnosis: Diagnosis) -> dict[str, float]:
    """The parameters of the autopilot to set: what a flight shows goes before what two files of them differ in."""
    return to_set(diagnosis.findings) | _advised(diagnosis.effects)


def _advised(effects: Iterable[FoundEffect]) -> dict[str, float]:
    return known(*(one.param for effect in effects if effect.is_likely for one in effect.advice))


def _covered(finding: Finding, advised: dict[str, float]) -> bool:
    return all(advised.get(name) == value for name, value in finding.param)
