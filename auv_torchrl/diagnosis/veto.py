"""No explanation stands against unseen flight: what predicts held-out stretches worse is not the verdict."""

from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.how_far import WITHIN_FLOOR, Predictions
from auv_torchrl.diagnosis.rollout import DIVERGING

WORSE = 1.05  # times the error


@DIVERGING
def scaled_errors(p: Predictions) -> np.ndarray:
    """Root mean square error (V,) of each vehicle over all held-out samples, in units of the floor."""
    scaled = (p.error / p.spread[:, None]) ** 2
    mean = np.array([scaled[:, v][p.windows.present].mean() for v in range(scaled.shape[1])])
    return np.sqrt(np.where(np.isfinite(mean), mean, np.inf))


def is_worse(p: Predictions, before: int, after: int) -> bool:
    """Whether one vehicle predicts the held-out stretches worse than another, by more than noise can do."""
    errors = scaled_errors(p)
    return bool(errors[after] > max(WORSE * errors[before], WITHIN_FLOOR))


def only(p: Predictions, before: int, after: int) -> Predictions:
    """The predictions of two of the vehicles."""
    return replace(p, error=p.error[:, [before, after]], states=p.states[:, [before, after]])
