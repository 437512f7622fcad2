"""What nobody foresees of a sound vehicle: by how much its healthy flights miss what is predicted of them.

A simulator that knows the vehicle still does not know what pushes it next, nor what every simulator of its kind leaves
out. Sensor noise and the estimated start, which a prediction begins from, tell nothing of that; healthy flights do.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.calibrate.calibration import Calibration
from auv_torchrl.diagnosis.identify.hypotheses import Settings, apply_values
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import FLEW_OFF
from auv_torchrl.diagnosis.validate.predict import HORIZONS_S, Predictions, predict_by
from auv_torchrl.flightlog import FlightLog

BIN_S = HORIZONS_S[0] / 2  # s of horizon, over which errors are averaged
BINS = round(HORIZONS_S[-1] / BIN_S)
MIDDLES = BIN_S * (np.arange(BINS) + 0.5)  # s


def unforeseen(healthy: Sequence[FlightLog], sound: Calibration | None, settings: Settings) -> dict[str, Floats]:
    """Variance by channel at ``MIDDLES``, (BINS,), of errors beyond the spread of a prediction; empty where none tell.

    Each flight is predicted by the vehicle that was fitted to it, with its own trim and current: what is left is what
    no such fit foresees, rather too little than too much.
    """
    fits = sound.flights_fit.fits if sound and sound.flights_fit else ()
    if len(fits) != len(healthy):
        return {}
    missed: dict[str, list[tuple[Floats, Floats]]] = {}
    for log, (problem, fit) in zip(healthy, fits, strict=True):
        own = apply_values(problem.vehicle, fit.explanation.values(problem.vehicle))
        p = predict_by(problem, log, [own], settings)
        beyond = np.clip(p.error[:, 0] ** 2, None, (FLEW_OFF * p.spread) ** 2) - p.spread**2
        time = p.windows.sampled
        for c, channel in enumerate(p.windows.channels):
            seen = p.windows.trust[..., c] > 0
            missed.setdefault(channel, []).append((time[seen], beyond[..., c][seen]))
    return {channel: _by_horizon(*map(np.concatenate, zip(*parts, strict=True))) for channel, parts in missed.items()}


def _by_horizon(time: Floats, beyond: Floats) -> Floats:
    """Means (BINS,) of squares at some times, and between where there are none."""
    at = np.minimum((time / BIN_S).astype(int), BINS - 1)
    count = np.bincount(at, minlength=BINS)
    if not count.any():
        return np.zeros(BINS)
    mean = np.bincount(at, np.nan_to_num(beyond), BINS)[count > 0] / count[count > 0]
    return np.interp(MIDDLES, MIDDLES[count > 0], np.maximum(mean, 0.0))


def widened(p: Predictions, variance: Mapping[str, Floats]) -> Predictions:
    """Predictions whose spread holds what nobody foresees, too."""
    time, none = p.windows.sampled, np.zeros(BINS)
    more = [np.interp(time, MIDDLES, variance.get(channel, none)) for channel in p.windows.channels]
    return replace(p, spread=np.sqrt(p.spread**2 + np.stack(more, -1)))
