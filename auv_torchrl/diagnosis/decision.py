"""How a verdict was reached: every explanation that was looked at, the runner-up, and why an effect is not named."""

import math

import numpy as np

from auv_torchrl.diagnosis.identify.found import Found
from auv_torchrl.diagnosis.identify.paths import Fit
from auv_torchrl.diagnosis.motion.smooth import noise_per_sample
from auv_torchrl.diagnosis.verdict import Decision, Hypothesis
from auv_torchrl.effects import EFFECTS
from auv_torchrl.quantities import words
from auv_torchrl.sysid.trace import Outcome, Record, SearchTrace

FLEW_OFF = 1e3  # standard deviations, beyond which a window says nothing but that its simulation flew off
TELLS = 0.1  # of what tells two explanations apart, above which a channel is worth a word


def decide(found: Found, refuted: bool) -> Decision:
    """How a log was explained; ``refuted`` where held-out flight took the best explanation back."""
    trace = found.trace
    if refuted:
        trace = trace.instead((), Outcome.REFUTED)
    second = trace.runner_up
    fits = {tuple(sorted(fit.explanation.effects)): fit for fit in reversed(found.fits)}
    apart = {}
    if second is not None and second.names in fits and trace.best.names in fits:
        apart = told_apart(found, fits[trace.best.names], fits[second.names])
    return Decision(
        trace=tuple(_hypothesis(record) for record in trace.records),
        reasons=_reasons(found, trace),
        next_best="" if second is None else _hypothesis(second).called,
        apart=apart,
    )


def told_apart(found: Found, one: Fit, other: Fit) -> dict[str, float]:
    """By channel, the share of the samples' chi-square that speaks for one fit against another, most first."""
    windows, sigma = found.problem.windows, found.problem.sigma
    noise = noise_per_sample(windows, sigma)
    far = [(fit.path.state.residual / noise).reshape(windows.measured.shape) for fit in (one, other)]
    flown = np.maximum(*np.abs(far)).max((1, 2)) < FLEW_OFF  # NaN, too, where a window diverged
    speaks = np.maximum((far[1][flown] ** 2 - far[0][flown] ** 2).sum((0, 1)), 0.0)
    if not speaks.sum() > 0:
        return {}
    shares = dict(zip(windows.channels, (speaks / speaks.sum()).tolist(), strict=True))
    return dict(sorted(((c, s) for c, s in shares.items() if s > TELLS), key=lambda item: -item[1]))


def _reasons(found: Found, trace: SearchTrace) -> dict[str, str]:
    """By effect of the library, why it is named, or why it is not."""
    problem = found.problem
    recorded = {name for record in trace.records for name in record.names}
    tried = {candidate.effect for candidate in problem.candidates}
    reasons = {}
    for name, effect in EFFECTS.items():
        if name in recorded:
            reasons[name] = words(trace.why(name))
        elif name in problem.settings.left_out:
            reasons[name] = "not looked for"
        elif name in tried:
            reasons[name] = "no change of it shows in this log"
        elif not effect.trial.is_asked(problem.windows.channels):
            reasons[name] = "not looked for: the log measures nothing that would show it"
        else:
            reasons[name] = "not looked for: it changes nothing on this vehicle, or a filter of the autopilot hides it"
    return reasons


def _hypothesis(record: Record) -> Hypothesis:
    evidence, misfit = (value if math.isfinite(value) else None for value in (record.log_evidence, record.misfit))
    return Hypothesis(record.names, record.values, evidence, record.log_prior, misfit, record.proposed, record.outcome)
