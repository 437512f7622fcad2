"""Without healthy flights: a vehicle's file that is a guess is corrected on the log itself.

A vehicle that published coefficients describe is off in many of them at once, and no search for a few clear effects
fits that. All uncertain coefficients are therefore fitted first, and kept where they predict unseen windows better.
Effects are then looked for beside coefficients that are as uncertain as the fit leaves them.

A pilot reads a correction as steady speeds and times: drag, thrust and inertia trade against each other, speeds
and times do not.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from auv_torchrl.diagnosis.axes import held_level, hold_attitude
from auv_torchrl.diagnosis.calibrate.flights import disturbance_floor
from auv_torchrl.diagnosis.calibrate.output_error import (
    NEARLY_SETTLED,
    CoefficientFit,
    as_values,
    fit_coefficients,
    measure_scale,
    pseudo_huber,
    simulate_errors,
)
from auv_torchrl.diagnosis.calibrate.parameters import Coefficient, VehicleEstimate
from auv_torchrl.diagnosis.calibrate.standing_out import Outlier, standing_out
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.fit import fit_by_simulation
from auv_torchrl.diagnosis.identify.hypotheses import Settings, apply_values, nuisance_parameters
from auv_torchrl.diagnosis.identify.paths import WindowPath
from auv_torchrl.diagnosis.identify.problem import HealthyPrior, Problem
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.motion.rollout import DIVERGING
from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.diagnosis.thresholds import (
    DIFFERS,
    MODEL_ERROR,
    MOVED,
    NOTICED,
    NOTICED_DRIFT,
    NOTICED_TURN,
    SHOWS_DRAG_S,
    SURELY_BETTER,
    WORTH_A_CORRECTION,
    Z95,
)
from auv_torchrl.diagnosis.verdict import Estimate, FoundEffect
from auv_torchrl.effects import EFFECTS
from auv_torchrl.effects.advice import which
from auv_torchrl.flightlog import Finding, FlightLog, Severity
from auv_torchrl.physics import CONTROL_DT
from auv_torchrl.quantities import counted, percent, quantity
from auv_torchrl.simulator import simulate
from auv_torchrl.vehicle import CONTROLLED, CONTROLLED_INDEX, Vehicle

WINDOW_S = 10.0  # s, as long as a prediction is wanted for; 5 s leave slow axes to the prior
LEAST_WINDOWS, MOST_WINDOWS = 6, 60  # ten minutes: more adds time, not certainty
FOLDS = 2
MOST_NAMED = 4  # coefficients of one effect that a sentence names
PASSES = 4  # of fitting the coefficients and measuring the floor, at most
SETTLED = 0.1  # relative change of the floor, below which passes end: windows of two minutes tell the floor no better
LASTS_S = 10.0  # s, after which a vehicle of this size goes steadily
RISEN = 0.632  # of the steady speed: the time constant
LEAST_COST = 1e-9  # of a window, where the prediction is exact
LEAST = 1e-3  # m/s, rad/s, s: least speed and time that a ratio is taken of
WORDS = {"surge": "forward", "sway": "sideways", "heave": "down", "yaw": "turning"}
Sentences = dict[str, tuple[str, ...]]  # by subject: ``axes``, ``idle``, ``turning``


@dataclass(frozen=True)
class Correction:
    """A vehicle with its coefficients as a log shows them, or as its file says where these predict no worse."""

    vehicle: Vehicle  # empty batch
    effects: tuple[FoundEffect, ...] = ()  # what was corrected, empty where nothing was
    sentences: tuple[str, ...] = ()  # for the summary
    findings: tuple[Finding, ...] = ()
    prior: HealthyPrior | None = None  # what the log leaves open of a corrected vehicle
    estimate: VehicleEstimate | None = None  # the corrected vehicle and the covariance of its coefficients

    def settings(self, settings: Settings) -> Settings:
        """Settings of a search on the log that was corrected on: the effects that are fitted already are left out."""
        fitted = [name for effect in self.effects for name in (effect.name, *EFFECTS[effect.name].trial.covers)]
        return replace(settings, ignored=tuple(dict.fromkeys((*settings.left_out, *fitted))))


def correct_file(
    log: FlightLog, vehicle: Vehicle, coefficients: Sequence[Coefficient], settings: Settings
) -> Correction:
    """Fit all uncertain coefficients on a log, and keep them if each half of it predicts the other better with them.

    Args:
        log: flight of the vehicle.
        vehicle: as its file says, empty batch.
        coefficients: what is uncertain in the file; the vehicle stays as it is where nothing is.
        settings: lead of the windows.
    """
    if not coefficients:
        return Correction(vehicle)
    held = hold_attitude(log, vehicle)
    windows = cut_windows(log, window_s(log, settings.lead_s), settings.lead_s)
    if len(windows) < LEAST_WINDOWS:
        sentence = (
            f"the vehicle's file is a guess, but the log is too short to correct it ({counted(len(windows), 'window')})"
        )
        return Correction(vehicle, findings=(Finding(Severity.WARNING, "too_short_to_calibrate", sentence),))
    windows = windows.thinned(MOST_WINDOWS)
    whole = fit_coefficients(windows, held, coefficients)
    gain = _cross_validate(windows, held, coefficients, whole)
    if not gain.is_worth_it:
        sentence = (
            f"the vehicle's file is a guess, but that correcting it predicts unseen windows better is not sure "
            f"({percent(-gain.share, sign=True)} of their error): its coefficients stand"
        )
        return Correction(vehicle, findings=(Finding(Severity.INFO, "coefficients_stand", sentence),))
    own = apply_values(vehicle, as_values(coefficients, whole.values))
    command = _typical_command(windows, vehicle)
    sentences = describe_differences(simulate_steps(vehicle, command), simulate_steps(own, command), command)
    effects = _list_effects(windows, held, coefficients, whole, gain.probability, sentences)
    sentence = (
        f"corrected on {log.name}: {counted(len(coefficients), 'coefficient')} of the vehicle's file; windows that "
        f"the fit did not see are predicted {percent(gain.share)} better"
    )
    finding = Finding(Severity.INFO, "coefficients_corrected", sentence)
    summary = sentences["axes"] + sentences["idle"] + sentences["turning"]
    estimate = estimate_from_fit(vehicle, coefficients, whole)
    return Correction(own, effects, summary, (finding,), build_prior(estimate, settings, windows.channels), estimate)


def window_s(log: FlightLog, lead_s: float) -> float:
    """The length in s of windows of a log: as long as it holds enough of them, but no shorter than drag shows in."""
    lengths = [0.99 * (episode.duration - lead_s) for episode in log.episodes]  # less what grid steps round off
    shorter = {length / parts for length in lengths for parts in range(2, 1 + LEAST_WINDOWS)}
    most = min(WINDOW_S, max(shorter))
    tried = sorted((one for one in {most, *shorter} if SHOWS_DRAG_S <= one <= most), reverse=True)
    enough = (one for one in tried if sum(int(length / one) for length in lengths) >= LEAST_WINDOWS)
    return next(enough, SHOWS_DRAG_S)


@dataclass(frozen=True)
class PredictionGain:
    """How much better unseen windows are predicted."""

    share: float  # of the error
    probability: float  # that the prediction is better at all

    @staticmethod
    def of(windows: Windows, before: Floats, after: Floats) -> "PredictionGain":
        """The gain from the errors ``before`` to those ``after``, (W, m, C) of the used channels each.

        The mean over windows is held against its standard error twice: of what each window gains, and of the logarithm
        of how many times. Beside one window with ten times the error of the others, what all of them gain looks like
        luck.
        """
        from scipy.special import ndtr  # of the normal distribution; here: it takes long to import

        scale, _ = measure_scale(windows, after)
        cost = [
            (pseudo_huber(error, scale) ** 2 * windows.present[..., None]).sum((1, 2)) for error in (before, after)
        ]  # (W,) each
        times = np.log(np.maximum(cost[0], LEAST_COST) / np.maximum(cost[1], LEAST_COST))
        surest = max(float(gain.mean() / max(_standard_error(gain), 1e-12)) for gain in (cost[0] - cost[1], times))
        share = 1 - np.sqrt(cost[1].sum() / cost[0].sum())
        return PredictionGain(float(share), float(ndtr(surest)))

    @property
    def is_worth_it(self) -> bool:
        """Whether the gain is large enough and no luck."""
        from scipy.special import ndtr

        return bool(self.share > WORTH_A_CORRECTION and self.probability > ndtr(SURELY_BETTER))


def _standard_error(values: Floats) -> float:
    return float(values.std(ddof=1) / np.sqrt(len(values)))


def _cross_validate(
    windows: Windows, held: Vehicle, coefficients: Sequence[Coefficient], whole: CoefficientFit
) -> PredictionGain:
    """The gain on each half of the windows by the fit to the other half, which begins at the fit to all of them."""
    nominal = np.array([c.nominal for c in coefficients])
    fold = np.arange(len(windows)) % FOLDS
    before, after = [], []
    for k in range(FOLDS):
        fitted = fit_coefficients(windows.subset(fold != k), held, coefficients, [whole.values], NEARLY_SETTLED)
        rows = [as_values(coefficients, at) for at in (nominal, fitted.values)]
        error = simulate_errors(windows.subset(fold == k), held, rows)
        before.append(error[0])
        after.append(error[1])
    order = np.concatenate([np.flatnonzero(fold == k) for k in range(FOLDS)])
    return PredictionGain.of(windows.subset(order), np.concatenate(before), np.concatenate(after))


def estimate_from_fit(vehicle: Vehicle, coefficients: Sequence[Coefficient], fitted: CoefficientFit) -> VehicleEstimate:
    """The vehicle with its fitted coefficients, and their covariance.

    Args:
        vehicle: as its file says, empty batch.
        coefficients: as the file says.
        fitted: the same coefficients (k,) as a log says.
    """
    entries = [(c.effect, c.member, c.nominal, c.width) for c in coefficients]
    file = VehicleEstimate.without_spread(vehicle, entries, fitted.covariance)
    return file.shifted(fitted.values - np.array([c.nominal for c in coefficients]))


def build_prior(estimate: VehicleEstimate, settings: Settings, channels: Collection[str]) -> HealthyPrior:
    """The prior of a search on the log that was corrected on; its floor and noise are still to be measured.

    Args:
        estimate: the corrected vehicle.
        settings: with the floor to begin from, and the widths of numbers that were not fitted.
        channels: of the log.
    """
    nuisance = estimate.nuisance.entries
    effects = {effect for effect, *_ in nuisance}
    fitted = effects | {name for effect in effects for name in EFFECTS[effect].trial.covers}
    others = [entry for entry in nuisance_parameters(estimate.vehicle, settings, channels) if entry[0] not in fitted]
    floor = np.array(settings.floor_force)
    return HealthyPrior(floor, {}, {}, nuisance, estimate.covariance, of_itself=True).beside(others)


def measure_own_floor(problem: Problem, path: WindowPath) -> Problem:
    """The problem with the disturbance that its own log shows, if that is more than assumed.

    Beside a file that is a guess, the floor of the settings would let waves become effects. A fault makes the measured
    disturbance larger than it is. The fault shows all the same: it replaces many forces by one.
    """
    prior, explanation = problem.known, Explanation()
    if prior is None:
        return problem
    whole = prior.floor
    for _ in range(PASSES):
        fit = fit_by_simulation(problem, explanation, path)
        if not np.isfinite(fit.chi2):
            break
        floor = np.maximum(whole[problem.layout.dof], disturbance_floor([(problem, fit)]))
        settled = bool((np.abs(floor / problem.floor - 1) < SETTLED).all())
        explanation, path, problem = fit.explanation, fit.path, replace(problem, floor=floor)
        if settled:
            break
    own = whole.copy()
    own[problem.layout.dof] = problem.floor
    return replace(problem, known=replace(prior, floor=own))


@dataclass(frozen=True)
class StepResponse:
    """Steady velocity (5, 6) under no command and under each of the four, and the time (5,) to get there."""

    steady: Floats
    time_s: Floats


@DIVERGING
def simulate_steps(vehicle: Vehicle, command: float) -> StepResponse:
    """Step commands from rest, one controlled degree of freedom at a time; roll and pitch are held level."""
    sent = np.zeros((1 + len(CONTROLLED), vehicle.thrusters))
    sent[1:] = np.clip(command * vehicle.mixer[:, CONTROLLED_INDEX].T, -1, 1)
    rows, times = len(sent), CONTROL_DT * np.arange(1 + round(LASTS_S / CONTROL_DT))
    held = np.repeat(sent[:, None], len(times) - 1, axis=1)
    velocity = simulate(held_level(vehicle), held, times).states[:, 1:, 7:].swapaxes(0, 1)  # (T, rows, 6)
    steady = velocity[-1]
    own = np.array([2, *CONTROLLED_INDEX])  # without a command, the vehicle can only rise or sink
    along = np.abs(velocity[:, np.arange(rows), own])
    return StepResponse(steady, (1 + np.argmax(along >= RISEN * along[-1], axis=0)) * CONTROL_DT)


@DIVERGING
def describe_differences(before: StepResponse, after: StepResponse, command: float) -> Sentences:
    """Sentences about what ``after`` does unlike ``before``, the axis that differs most first."""
    axes: list[tuple[float, str]] = []
    for row, (name, degree) in enumerate(zip(CONTROLLED, CONTROLLED_INDEX, strict=True), start=1):
        unit = "rad/s" if degree > 2 else "m/s"
        speed = [abs(response.steady[row, degree]) for response in (before, after)]
        time = [response.time_s[row] for response in (before, after)]
        if abs(speed[1] / speed[0] - 1) > NOTICED or abs(time[1] / time[0] - 1) > NOTICED:
            filed, found = (quantity(value, unit, 2) for value in speed)
            sentence = (
                f"{WORDS[name]} it does {found} at command {command:g}, and gets there with a time "
                f"constant of {time[1]:.1f} s (the file says {filed} and {time[0]:.1f} s)"
            )
            axes.append((sum(abs(np.log(max(now, LEAST) / then)) for then, now in (speed, time)), sentence))
    idle = []
    drift = after.steady[0, 2]
    if abs(drift - before.steady[0, 2]) > NOTICED_DRIFT:
        idle.append(f"idle it {'rises' if drift < 0 else 'sinks'} at {abs(drift):.2f} m/s")
    turning = []
    for row, name in enumerate(CONTROLLED[:-1], start=1):
        rate = after.steady[row, 5]
        if abs(rate - before.steady[row, 5]) > NOTICED_TURN:
            turning.append(f"a {name} command of {command:g} also turns it at {quantity(rate, 'rad/s', 2, sign=True)}")
    most_first = sorted(axes, key=lambda axis: -axis[0])
    return {"axes": tuple(sentence for _, sentence in most_first), "idle": tuple(idle), "turning": tuple(turning)}


def _typical_command(windows: Windows, vehicle: Vehicle) -> float:
    """Size of the log's commands, to two figures."""
    size = np.abs(windows.commands).max(-1)
    size = size[size > 0.02]
    return float(f"{np.median(size):.2g}") if size.size else 0.5


def _list_effects(
    windows: Windows,
    held: Vehicle,
    coefficients: Sequence[Coefficient],
    fitted: CoefficientFit,
    probability: float,
    sentences: Sentences,
) -> tuple[FoundEffect, ...]:
    """The corrections by effect, first the effect that the prediction needs most."""
    nominal = np.array([c.nominal for c in coefficients])
    deviation = np.sqrt(np.diag(fitted.covariance))
    names = list(dict.fromkeys(c.effect for c in coefficients))
    of_effect = {name: np.array([c.effect == name for c in coefficients]) for name in names}
    rows = [nominal, fitted.values, *(np.where(of_effect[name], nominal, fitted.values) for name in names)]
    error = simulate_errors(windows, held, [as_values(coefficients, at) for at in rows])
    present = windows.present[..., None]
    cost = [(pseudo_huber(row, fitted.scale) ** 2 * present).sum() for row in error]
    found = []
    for place, name in enumerate(names):
        share = float(np.clip((cost[2 + place] - cost[1]) / max(cost[0] - cost[1], 1e-12), 0.0, 1.0))
        parameters, moved = {}, []
        for c, value, sd in zip(coefficients, fitted.values, deviation, strict=True):
            if c.effect != name:
                continue
            half = Z95 * float(np.hypot(sd, MODEL_ERROR * (value - c.nominal)))
            low, high = max(c.low, value - half), min(c.high, value + half)
            parameters[c.member] = Estimate(float(value), float(low), float(high), c.nominal, c.unit)
            if abs(value - c.nominal) > max(DIFFERS * sd, MOVED * c.width):
                moved.append(c)
        seen = sentences.get(EFFECTS[name].trial.shows, ())
        own = (*seen, *_describe_coefficients(held, name, moved, parameters)) if moved or not seen else seen
        found.append(FoundEffect(name, probability, parameters, (), share, "; ".join(own), calibrates=True))
    outliers = standing_out(coefficients, fitted.values, fitted.covariance)
    found = [_with_faults(effect, [one for one in outliers if one.effect == effect.name]) for effect in found]
    return tuple(sorted(found, key=lambda effect: -(effect.gap_closed or 0.0)))


def _with_faults(correction: FoundEffect, outliers: Sequence[Outlier]) -> FoundEffect:
    """A correction as a fault of those thrusters that depart from the others; as it is where none does."""
    if not outliers:
        return correction
    effect = EFFECTS[correction.name]
    ratios = {one.member: one.ratio for one in outliers}
    return replace(
        correction,
        probability=min(correction.probability, *(one.probability for one in outliers)),
        thrusters=tuple(sorted(int(which(member)) for member in ratios)),
        sentence="; ".join(f"thruster {which(m)} gives {r:z.2f} times what the others give" for m, r in ratios.items()),
        advice=effect.advice(ratios, {}) if effect.advice else (),
        calibrates=False,
    )


def _describe_coefficients(
    vehicle: Vehicle, name: str, moved: Sequence[Coefficient], parameters: dict[str, Estimate]
) -> tuple[str, ...]:
    """Sentences of an effect about the coefficients that clearly moved; one sentence where these are many."""
    if not moved:
        return ("as the file says, as far as this log can tell",)
    if len(moved) > MOST_NAMED:
        values = [parameters[c.member].value for c in moved]
        spread = f", from {min(values):.2f} to {max(values):.2f}" if len(EFFECTS[name].parameters) == 1 else ""
        return (f"{len(moved)} of its {counted(len(parameters), 'coefficient')} differ from the file{spread}",)
    declared = EFFECTS[name].member_parameters(vehicle)
    return tuple(declared[c.member].sentence_of(c.member, parameters[c.member].value) for c in moved)
