"""What is left of windows that are simulated from their starts, with many coefficients at once.

Output error (Ljung 1999, section 3.2) instead of the innovations of the search: where a vehicle's file is a guess, what
counts is the prediction over seconds from the commands alone, and the error is the model's, not the sensors'.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auv_torchrl.diagnosis.calibrate.uncertainty import Coefficient
from auv_torchrl.diagnosis.identify.hypotheses import Values, batch
from auv_torchrl.diagnosis.motion.actuation import actuate
from auv_torchrl.diagnosis.motion.rollout import fly
from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.diagnosis.thresholds import FLEW_OFF, HUBER
from auv_torchrl.flightlog import POSE
from auv_torchrl.vehicle import Vehicle

START_WIDTH = np.array([0.1] * 6 + [0.1] * 3 + [0.3] * 3)  # m, rad, m/s, rad/s, of a start about its guess
UNSEEN_BY_VELOCITY = (0, 1, 2, 5)  # position and yaw
SMALLEST = 1e-6  # a channel's scale, where nothing is left at all


@dataclass(frozen=True)
class Fitted:
    """Coefficients with what the data and the prior say of them."""

    values: Floats  # (k,)
    covariance: Floats  # (k, k)
    scale: Floats  # (C,) robust standard deviation of what is left, by channel that is used


def used_channels(windows: Windows) -> np.ndarray:
    """Columns of the channels to fit: velocities, and poses where their velocity is not measured."""
    here = set(windows.channels)
    together = {"x": "uv", "y": "uv", "z": "w", "roll": "p", "pitch": "q", "yaw": "r"}
    return np.array([i for i, c in enumerate(windows.channels) if not (c in together and set(together[c]) <= here)])


def errors(windows: Windows, vehicle: Vehicle, rows: list[Values], starts: Floats | None = None) -> Floats:
    """Measured less predicted (R, W, m, C) of the used channels, for each row of effect values.

    ``starts`` (W, R or 1, 12) are those of the windows; None for their guesses.
    """
    begin = windows.guess[:, None] if starts is None else starts
    predicted, _ = fly(actuate(windows, batch(vehicle, rows)), begin)
    left = windows.residual(predicted)
    return np.moveaxis(left[..., used_channels(windows)], 1, 0)


def as_values(coefficients: Sequence[Coefficient], at: Floats) -> Values:
    """Effect values of coefficients."""
    values: Values = {}
    for c, value in zip(coefficients, at.tolist(), strict=True):
        values.setdefault(c.effect, {})[c.member] = value
    return values


def measure_scale(windows: Windows, left: Floats) -> tuple[Floats, float]:
    """Robust standard deviation (C,) of what is left (W, m, C), and over how many samples it is correlated.

    One number of samples for all channels: a channel that drifts slowly while nothing is asked of it would otherwise
    weigh next to nothing while something is.
    """
    seen = windows.trust[..., used_channels(windows)] > 0
    inside = np.where(seen, np.where(np.isfinite(left), left, np.inf), np.nan)
    inside = inside[seen.any(-1)]
    middle = 1.4826 * np.nanmedian(np.abs(inside), axis=0)
    cut = np.clip(inside, -3 * middle, 3 * middle)
    scale = np.maximum(np.maximum(np.sqrt(np.nanmean(cut**2, axis=0)), middle), SMALLEST)
    # first-order correlation of neighbours: (1 + rho) / (1 - rho) samples say as much as one
    near = (seen[:, 1:] & seen[:, :-1]).any(-1)
    clipped = np.clip(np.nan_to_num(left), -3 * scale, 3 * scale)
    now, then = clipped[:, 1:][near], clipped[:, :-1][near]
    rho = np.clip((now * then).mean(0) / (0.5 * (now**2 + then**2)).mean(0).clip(SMALLEST**2), 0.0, 0.98)
    return scale, float(np.median((1 + rho) / (1 - rho)))


def pseudo_huber(left: Floats, scale: Floats) -> Floats:
    """Numbers whose squares grow like those of ``left / scale`` while it is small, and linearly beyond."""
    r = np.clip(np.nan_to_num(left / scale, nan=FLEW_OFF, posinf=FLEW_OFF, neginf=-FLEW_OFF), -FLEW_OFF, FLEW_OFF)
    return np.sign(r) * HUBER * np.sqrt(2 * (np.sqrt(1 + (r / HUBER) ** 2) - 1))


def start_entries(windows: Windows, vehicle: Vehicle) -> np.ndarray:
    """Which of the 12 numbers of a start are free: those that the used channels can see."""
    moves = np.flatnonzero(vehicle.free.numpy() > 0)
    entries = np.concatenate([moves, moves + 6])
    poses = any(windows.channels[i] in POSE for i in used_channels(windows))
    return entries if poses else np.setdiff1d(entries, UNSEEN_BY_VELOCITY)


def scaled(windows: Windows, left: Floats, scale: Floats, memory: float) -> Floats:
    """Numbers (R, W, m C) whose squares add up to the cost of what is left (R, W, m, C)."""
    r = pseudo_huber(left, scale) * windows.present[..., None] / np.sqrt(memory)
    return r.reshape(*r.shape[:2], -1)
