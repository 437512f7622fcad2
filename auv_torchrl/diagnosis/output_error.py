"""Fit many coefficients at once: simulate windows from their measured starts and shrink what is left.

Output error (Ljung 1999, section 3.2) instead of the innovations of the search: where a vehicle's file is a guess, what
counts is the prediction over seconds from the commands alone, and the error is the model's, not the sensors'.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auv_torchrl.diagnosis.hypotheses import Values, batch
from auv_torchrl.diagnosis.rollout import simulate
from auv_torchrl.diagnosis.uncertainty import Coefficient
from auv_torchrl.diagnosis.windows import Floats, Windows
from auv_torchrl.vehicle import Vehicle

STEP = 1e-3  # of a coefficient's width, for slopes
HUBER = 2.5  # standard deviations from which a sample counts less: one corrupted row must not turn the fit
LOST = 30.0  # standard deviations at which a sample of a vehicle that flew off is cut
DAMPING = (1e-3, 3e-2, 1.0, 30.0)  # tried side by side in every round
ROUNDS = 25
SETTLED = 1e-3  # relative fall of the cost below which the fit stands
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


def errors(windows: Windows, vehicle: Vehicle, rows: list[Values]) -> Floats:
    """Measured less predicted (R, W, m, C) of the used channels, for each row of effect values."""
    left = windows.residual(simulate(windows, batch(vehicle, rows), windows.guess[:, None]))
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
    present = windows.present
    inside = left[present]
    inside = np.where(np.isfinite(inside), inside, np.inf)
    middle = 1.4826 * np.median(np.abs(inside), axis=0)
    cut = np.clip(inside, -3 * middle, 3 * middle)
    scale = np.maximum(np.maximum(np.sqrt((cut**2).mean(0)), middle), SMALLEST)
    # first-order correlation of neighbours: (1 + rho) / (1 - rho) samples say as much as one
    near = present[:, 1:] & present[:, :-1]
    clipped = np.clip(np.nan_to_num(left), -3 * scale, 3 * scale)
    now, then = clipped[:, 1:][near], clipped[:, :-1][near]
    rho = np.clip((now * then).mean(0) / (0.5 * (now**2 + then**2)).mean(0).clip(SMALLEST**2), 0.0, 0.98)
    return scale, float(np.median((1 + rho) / (1 - rho)))


def pseudo_huber(left: Floats, scale: Floats) -> Floats:
    """Numbers whose squares grow like those of ``left / scale`` while it is small, and linearly beyond."""
    r = np.clip(np.nan_to_num(left / scale, nan=LOST, posinf=LOST, neginf=-LOST), -LOST, LOST)
    return np.sign(r) * HUBER * np.sqrt(2 * (np.sqrt(1 + (r / HUBER) ** 2) - 1))


def fit(windows: Windows, vehicle: Vehicle, coefficients: Sequence[Coefficient], rounds: int = ROUNDS) -> Fitted:
    """Levenberg-Marquardt within the bounds, from the values of the vehicle, priors as wide as they are uncertain.

    The scale of each channel and the correlation of the errors are measured anew in every round, so that neither a
    channel that no coefficient explains nor a thousand samples of one slow error outweigh the prior.
    """
    nominal = np.array([c.nominal for c in coefficients])
    width = np.array([c.width for c in coefficients])
    low, high = np.array([c.low for c in coefficients]), np.array([c.high for c in coefficients])
    at, step = nominal.copy(), STEP * width

    def simulated(points: list[Floats]) -> Floats:
        return errors(windows, vehicle, [as_values(coefficients, point) for point in points])

    def scaled(left: Floats, scale: Floats, memory: float) -> Floats:
        return (pseudo_huber(left, scale) * windows.present[..., None]).reshape(len(left), -1) / np.sqrt(memory)

    for round_ in range(rounds):  # the last one only takes the slopes
        forward = np.where(at + step > high, -step, step)
        left = simulated([at, *(at + forward * unit for unit in np.eye(len(at)))])
        scale, memory = measure_scale(windows, left[0])
        r = scaled(left, scale, memory)
        slope = (r[1:] - r[0]) / forward[:, None]
        away = (at - nominal) / width
        cost = float(r[0] @ r[0] + away @ away)
        gradient = slope @ r[0] + away / width
        curvature = slope @ slope.T + np.diag(width**-2.0)
        if round_ == rounds - 1:
            break
        free = ~(((at <= low) & (gradient > 0)) | ((at >= high) & (gradient < 0)))
        trials = []
        for damping in DAMPING:
            inside = curvature[np.ix_(free, free)]
            move = np.zeros(len(at))
            move[free] = -np.linalg.solve(inside + damping * np.diag(np.diag(inside)), gradient[free])
            trials.append(np.clip(at + move, low, high))
        costs = [
            float(row @ row + (((trial - nominal) / width) ** 2).sum())
            for trial, row in zip(trials, scaled(simulated(trials), scale, memory), strict=True)
        ]
        best = int(np.argmin(costs))
        if costs[best] > cost * (1 - SETTLED):
            break
        at = trials[best]
    return Fitted(at, np.linalg.inv(curvature), scale)
