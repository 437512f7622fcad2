"""Calibrate a vehicle whose file is a guess: all uncertain coefficients at once, kept if they predict unseen flight.

A vehicle described by published coefficients is off in many of them at once, which no search for a few clear effects
fits. So the whole file is corrected first, and effects are looked for on top of that.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr  # of the normal distribution; scipy.stats has it too, and takes a second to import

from auv_torchrl.diagnosis.calibrate.descent import NEARLY_SETTLED, fit
from auv_torchrl.diagnosis.calibrate.left_open import fitted_about, left_open
from auv_torchrl.diagnosis.calibrate.manoeuvres import differences, respond
from auv_torchrl.diagnosis.calibrate.nuisance import Centred
from auv_torchrl.diagnosis.calibrate.output_error import Fitted, as_values, errors, measure_scale, pseudo_huber
from auv_torchrl.diagnosis.calibrate.uncertainty import Coefficient
from auv_torchrl.diagnosis.identify.attitude import hold_attitude
from auv_torchrl.diagnosis.identify.hypotheses import Settings, apply_values
from auv_torchrl.diagnosis.identify.problem import Known
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.diagnosis.thresholds import (
    DIFFERS,
    MODEL_ERROR,
    MOVED,
    SHOWS_DRAG_S,
    SURELY_BETTER,
    WORTH_A_CORRECTION,
    Z95,
)
from auv_torchrl.diagnosis.verdict import Estimate, FoundEffect
from auv_torchrl.effects import EFFECTS
from auv_torchrl.flightlog import Finding, FlightLog, Severity
from auv_torchrl.quantities import counted, percent
from auv_torchrl.vehicle import Vehicle

WINDOW_S = 10.0  # s, as long as a prediction is wanted for; 5 s leave slow axes to the prior
LEAST_WINDOWS, MOST_WINDOWS = 6, 60  # ten minutes: more adds time, not certainty
FOLDS = 2
MOST_NAMED = 4  # coefficients of one effect that a sentence names


@dataclass(frozen=True)
class Calibrated:
    """A vehicle with its coefficients as a log shows them, or as it was where that predicts no better."""

    vehicle: Vehicle  # empty batch
    effects: tuple[FoundEffect, ...] = ()  # what was corrected, empty where nothing was
    sentences: tuple[str, ...] = ()  # for the summary
    findings: tuple[Finding, ...] = ()
    known: Known | None = None  # what the log leaves open of it, where something was corrected,
    about: Centred | None = None  # and where the file is from there

    def settings(self, settings: Settings) -> Settings:
        """Settings of a search on the log that was calibrated on: what is fitted already is not looked for again."""
        fitted = [name for effect in self.effects for name in (effect.name, *EFFECTS[effect.name].covers)]
        return replace(settings, ignored=tuple(dict.fromkeys((*settings.left_out, *fitted))))


def calibrate_coefficients(
    log: FlightLog, vehicle: Vehicle, coefficients: Sequence[Coefficient], settings: Settings
) -> Calibrated:
    """Fit all uncertain coefficients on a log, and keep them if each half of it predicts the other better with them.

    Args:
        log: flight of the vehicle.
        vehicle: as its file says, empty batch.
        coefficients: what is uncertain in it; where nothing is, the vehicle stays as it is.
        settings: lead of the windows.
    """
    if not coefficients:
        return Calibrated(vehicle)
    held = hold_attitude(log, vehicle)
    longest = max(episode.duration for episode in log.episodes) - settings.lead_s
    windows = cut_windows(log, max(SHOWS_DRAG_S, min(WINDOW_S, 0.5 * longest)), settings.lead_s)
    if len(windows) < LEAST_WINDOWS:
        sentence = (
            f"the vehicle's file is a guess, but the log is too short to correct it ({counted(len(windows), 'window')})"
        )
        return Calibrated(vehicle, findings=(Finding(Severity.WARNING, "too_short_to_calibrate", sentence),))
    if len(windows) > MOST_WINDOWS:
        windows = windows.subset(np.linspace(0, len(windows) - 1, MOST_WINDOWS).astype(int))
    nothing = np.array([c.nominal for c in coefficients])
    fold = np.arange(len(windows)) % FOLDS
    before, after, whole = [], [], fit(windows, held, coefficients)
    for k in range(FOLDS):
        fitted = fit(windows.subset(fold != k), held, coefficients, [whole.values], NEARLY_SETTLED)
        unseen = windows.subset(fold == k)
        left = errors(unseen, held, [as_values(coefficients, at) for at in (nothing, fitted.values)])
        before.append(left[0])
        after.append(left[1])
    order = np.concatenate([np.flatnonzero(fold == k) for k in range(FOLDS)])
    gain = Gain.of(windows.subset(order), np.concatenate(before), np.concatenate(after))
    if not gain.better:
        sentence = (
            f"the vehicle's file is a guess, but correcting it predicts unseen windows no better "
            f"({percent(gain.share, sign=True)} of their error): its coefficients stand"
        )
        return Calibrated(vehicle, findings=(Finding(Severity.INFO, "coefficients_stand", sentence),))
    own = apply_values(vehicle, as_values(coefficients, whole.values))
    command = _typical_command(windows, vehicle)
    said = differences(respond(vehicle, command), respond(own, command), command)
    effects = _effects(windows, held, coefficients, whole, gain.probability, said)
    sentence = (
        f"corrected on {log.name}: {counted(len(coefficients), 'coefficient')} of the vehicle's file; windows that "
        f"the fit did not see are predicted {percent(gain.share)} better"
    )
    finding = Finding(Severity.INFO, "coefficients_corrected", sentence)
    sentences = said["axes"] + said["idle"] + said["turning"]
    about = fitted_about(vehicle, coefficients, whole)
    known = left_open(about, settings, windows.channels)
    return Calibrated(own, effects, sentences, (finding,), known, about)


@dataclass(frozen=True)
class Gain:
    """How much better unseen windows are predicted."""

    share: float  # of the error
    probability: float  # that it is better at all

    @staticmethod
    def of(windows: Windows, before: Floats, after: Floats) -> "Gain":
        """That of what is left of windows, (W, m, C) of the used channels each, before and after."""
        scale, _ = measure_scale(windows, after)
        cost = [
            (pseudo_huber(left, scale) ** 2 * windows.present[..., None]).sum((1, 2)) for left in (before, after)
        ]  # (W,) each
        paid = cost[0] - cost[1]
        error = paid.std(ddof=1) / np.sqrt(len(paid))
        share = 1 - np.sqrt(cost[1].sum() / cost[0].sum())
        return Gain(float(share), float(ndtr(paid.mean() / max(error, 1e-12))))

    @property
    def better(self) -> bool:
        """Whether that is worth it and no luck."""
        return bool(self.share > WORTH_A_CORRECTION and self.probability > ndtr(SURELY_BETTER))


def _typical_command(windows: Windows, vehicle: Vehicle) -> float:
    """Size of the commands that were flown, to two figures."""
    size = np.abs(windows.commands).max(-1)
    size = size[size > 0.02]
    return float(f"{np.median(size):.2g}") if size.size else 0.5


def _effects(
    windows: Windows,
    held: Vehicle,
    coefficients: Sequence[Coefficient],
    fitted: Fitted,
    probability: float,
    said: dict[str, tuple[str, ...]],
) -> tuple[FoundEffect, ...]:
    """The corrections by effect, the one that the prediction needs most first."""
    nominal = np.array([c.nominal for c in coefficients])
    deviation = np.sqrt(np.diag(fitted.covariance))
    names = list(dict.fromkeys(c.effect for c in coefficients))
    mine = {name: np.array([c.effect == name for c in coefficients]) for name in names}
    rows = [nominal, fitted.values, *(np.where(mine[name], nominal, fitted.values) for name in names)]
    left = errors(windows, held, [as_values(coefficients, at) for at in rows])
    present = windows.present[..., None]
    cost = [(pseudo_huber(row, fitted.scale) ** 2 * present).sum() for row in left]
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
        extra = said.get(EFFECTS[name].shows, ())
        told = (*extra, *_sentences(held, name, moved, parameters)) if moved or not extra else extra
        sentence = "; ".join(told)
        found.append(FoundEffect(name, probability, parameters, (), share, sentence, calibrates=True))
    return tuple(sorted(found, key=lambda effect: -(effect.gap_closed or 0.0)))


def _sentences(
    vehicle: Vehicle, name: str, moved: list[Coefficient], parameters: dict[str, Estimate]
) -> tuple[str, ...]:
    """What the effect says of the coefficients that differ clearly; a family together, too many in one word."""
    if not moved:
        return ("as the file says, as far as this log can tell",)
    if len(moved) > MOST_NAMED:
        values = [parameters[c.member].value for c in moved]
        spread = f", from {min(values):.2f} to {max(values):.2f}" if len(EFFECTS[name].parameters) == 1 else ""
        return (f"{len(moved)} of its {counted(len(parameters), 'coefficient')} differ from the file{spread}",)
    declared = EFFECTS[name].member_parameters(vehicle)
    return tuple(declared[c.member].said(c.member, parameters[c.member].value) for c in moved)
