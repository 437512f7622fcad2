"""No explanation stands against unseen flight: what predicts held-out stretches badly does not explain the gap."""

from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.motion.rollout import DIVERGING
from auv_torchrl.diagnosis.thresholds import CLOSED_IF_EXPLAINED, STILL_FAR, WITHIN_FLOOR, WORSE
from auv_torchrl.diagnosis.validate.predict import Predictions
from auv_torchrl.flightlog import Finding, Severity
from auv_torchrl.quantities import percent


@DIVERGING
def scaled_errors(p: Predictions) -> np.ndarray:
    """Root mean square error (V,) of each vehicle over all held-out samples, in units of the floor."""
    scaled = (p.error / p.spread[:, None]) ** 2
    mean = np.array([scaled[:, v][p.windows.trust > 0].mean() for v in range(scaled.shape[1])])
    return np.sqrt(np.where(np.isfinite(mean), mean, np.inf))


def is_worse(p: Predictions, before: int, after: int) -> bool:
    """Whether one vehicle predicts the held-out stretches worse than another, by more than noise can do."""
    errors = scaled_errors(p)
    return bool(errors[after] > max(WORSE * errors[before], WITHIN_FLOOR))


def falls_short(p: Predictions, closed: float | None) -> bool:
    """Whether the last vehicle leaves more of the gap than an explanation may, though it fits what was learnt from."""
    return closed is not None and closed < CLOSED_IF_EXPLAINED and bool(scaled_errors(p)[-1] > STILL_FAR)


def only(p: Predictions, before: int, after: int) -> Predictions:
    """The predictions of two of the vehicles."""
    two = {name: getattr(p, name)[:, [before, after]] for name in ("error", "states", "reported")}
    return replace(p, **two)


def shortfalls(short: bool) -> tuple[Finding, ...]:
    """What is said where effects fit the log, but do not predict held-out flight."""
    if not short:
        return ()
    sentence = (
        f"the effects fit this log, but close less than {percent(CLOSED_IF_EXPLAINED)} of the gap in held-out flight"
    )
    return (Finding(Severity.WARNING, "falls_short", sentence, "Fly what next_experiment.csv commands"),)


def vetoes(vetoed: bool) -> tuple[Finding, ...]:
    """What was thrown away because held-out flight speaks against it."""
    if not vetoed:
        return ()
    sentence = "the effects that fit this log best predict held-out flight worse than without them: none is named"
    return (Finding(Severity.WARNING, "vetoed", sentence, "Give a longer log, or one that moves in more ways"),)
