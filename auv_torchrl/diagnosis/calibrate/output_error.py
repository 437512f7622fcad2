"""Fit many coefficients at once: simulate windows from their starts and shrink what is left.

Output error (Ljung 1999, section 3.2) instead of the innovations of the search: where a vehicle's file is a guess, what
counts is the prediction over seconds from the commands alone, and the error is the model's, not the sensors'.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auv_torchrl.diagnosis.calibrate.uncertainty import Coefficient
from auv_torchrl.diagnosis.identify.hypotheses import Values, batch
from auv_torchrl.diagnosis.motion.rollout import simulate
from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.diagnosis.thresholds import FLEW_OFF, HUBER, SHARED_BY_THRUSTERS
from auv_torchrl.effects import EFFECTS
from auv_torchrl.flightlog import POSE
from auv_torchrl.vehicle import Vehicle

STEP = 1e-3  # of a coefficient's width, for slopes
ROUGH_STEP = 0.2  # likewise of a threshold, which switches single samples: enough of them must do so to make a slope
DAMPING = (1e-3, 3e-2, 1.0, 30.0)  # tried side by side in every round
ROUNDS = 25
SETTLED = 1e-3  # relative fall of the cost below which the fit stands
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
    left = windows.residual(simulate(windows, batch(vehicle, rows), begin))
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


def prior_covariance(coefficients: Sequence[Coefficient]) -> Floats:
    """Covariance (k, k) of coefficients before any flight.

    What makes all members of a family differ from flight to flight, as volts do all thrusters, is also what a file has
    wrong of all of them. Else a fit would rather bend the curve of thrust than pay once for each thruster, and go wrong
    where commands are larger than those that it has seen.
    """
    width = np.array([c.width for c in coefficients])
    family = [c.family for c in coefficients]
    same = np.array([[one is not None and one == other for other in family] for one in family])
    return np.outer(width, width) * np.where(np.eye(len(width), dtype=bool), 1.0, SHARED_BY_THRUSTERS * same)


def fit(windows: Windows, vehicle: Vehicle, coefficients: Sequence[Coefficient], rounds: int = ROUNDS) -> Fitted:
    """Levenberg-Marquardt within the bounds, from the values of the vehicle, priors as wide as they are uncertain.

    Each window starts near its guess, where the coefficients want it. The scale of each channel and the correlation of
    the errors are measured anew in every round, so that neither a channel that no coefficient explains nor a thousand
    samples of one slow error outweigh the prior.
    """
    nominal = np.array([c.nominal for c in coefficients])
    width = np.array([c.width for c in coefficients])
    low, high = np.array([c.low for c in coefficients]), np.array([c.high for c in coefficients])
    at, k, known = nominal.copy(), len(coefficients), np.linalg.inv(prior_covariance(coefficients))
    reach = width * np.where([EFFECTS[c.effect].is_rough for c in coefficients], ROUGH_STEP, STEP)
    entries = start_entries(windows, vehicle)
    start, loose = windows.guess.copy(), START_WIDTH[entries]

    def cost(r: Floats, point: Floats, starts: Floats) -> float:
        moved = (starts - windows.guess)[:, entries] / loose
        return float((r**2).sum() + (point - nominal) @ known @ (point - nominal) + (moved**2).sum())

    while True:
        step = np.where(at + reach > high, -reach, reach)
        points = [at, *(at + step * unit for unit in np.eye(k)), *[at] * len(entries)]
        starts = np.repeat(start[:, None], len(points), axis=1)
        starts[:, np.arange(1 + k, len(points)), entries] += STEP * loose
        left = errors(windows, vehicle, [as_values(coefficients, point) for point in points], starts)
        scale, memory = measure_scale(windows, left[0])
        r = _scaled(windows, left, scale, memory)
        slope = (r[1 : 1 + k] - r[0]) / step[:, None, None]
        local = (r[1 + k :] - r[0]) / (STEP * loose)[:, None, None]
        gram = np.einsum("lwn,mwn->wlm", local, local) + np.diag(loose**-2.0)
        cross = np.einsum("lwn,kwn->wlk", local, slope)
        pull = np.einsum("lwn,wn->wl", local, r[0]) + (start - windows.guess)[:, entries] / loose**2
        response, offset = np.linalg.solve(gram, cross), np.linalg.solve(gram, pull[..., None])[..., 0]
        curvature = np.einsum("iwn,jwn->ij", slope, slope) - np.einsum("wli,wlj->ij", cross, response)
        curvature = 0.5 * (curvature + curvature.T) + known
        gradient = np.einsum("kwn,wn->k", slope, r[0]) - np.einsum("wlk,wl->k", cross, offset)
        gradient += known @ (at - nominal)
        fitted, rounds = Fitted(at, np.linalg.inv(curvature), scale), rounds - 1
        if not rounds:  # the last one only takes the slopes
            return fitted
        free = ~(((at <= low) & (gradient > 0)) | ((at >= high) & (gradient < 0)))
        trials = []
        for damping in DAMPING:
            inside = curvature[np.ix_(free, free)]
            move = np.zeros(k)
            move[free] = -np.linalg.solve(inside + damping * np.diag(np.diag(inside)), gradient[free])
            trials.append(np.clip(at + move, low, high))
        starts = np.repeat(start[:, None], len(trials), axis=1)
        starts[..., entries] -= np.stack([offset + response @ (trial - at) for trial in trials], axis=1)
        tried = errors(windows, vehicle, [as_values(coefficients, trial) for trial in trials], starts)
        tried = _scaled(windows, tried, scale, memory)
        costs = [cost(tried[i], trial, starts[:, i]) for i, trial in enumerate(trials)]
        best = int(np.argmin(costs))
        if costs[best] > cost(r[0], at, start) * (1 - SETTLED):
            return fitted
        at, start = trials[best], starts[:, best]


def start_entries(windows: Windows, vehicle: Vehicle) -> np.ndarray:
    """Which of the 12 numbers of a start are free: those that the used channels can see."""
    moves = np.flatnonzero(vehicle.free.numpy() > 0)
    entries = np.concatenate([moves, moves + 6])
    poses = any(windows.channels[i] in POSE for i in used_channels(windows))
    return entries if poses else np.setdiff1d(entries, UNSEEN_BY_VELOCITY)


def _scaled(windows: Windows, left: Floats, scale: Floats, memory: float) -> Floats:
    """Numbers (R, W, m C) whose squares add up to the cost of what is left (R, W, m, C)."""
    r = pseudo_huber(left, scale) * windows.present[..., None] / np.sqrt(memory)
    return r.reshape(*r.shape[:2], -1)
