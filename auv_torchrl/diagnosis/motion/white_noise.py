"""The white noise of each channel: roughly before anything is followed, and of what is left once everything is."""

import numpy as np

from auv_torchrl.diagnosis.motion.rollout import DIVERGING
from auv_torchrl.diagnosis.motion.slopes import chunks
from auv_torchrl.diagnosis.motion.smooth import Smoothed, noise_per_sample
from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.diagnosis.thresholds import LEAST_FREEDOM, LEAST_NOISE
from auv_torchrl.flightlog.log import ANGLES
from auv_torchrl.sensors import CHANNELS

ROUNDING = 12**-0.5  # standard deviation of a rounding error, in steps: no noise is believed below it


@DIVERGING
def sensor_noise(windows: Windows, state: Smoothed, sigma: dict[str, float], force_prior: Floats) -> dict[str, float]:
    """White noise of each channel, from what is left when a force held by ``force_prior`` (D,) has followed the rest.

    A channel with so few samples that the force follows its noise, too, is left out.
    """
    weight = 1.0 / noise_per_sample(windows, sigma)
    whole, leverage = state.slope, np.empty(state.residual.shape)
    starts = whole.shape[-1] - state.bins[0].size
    precision = np.concatenate([np.full(starts, 1e-6), np.tile(force_prior**-2, state.bins.shape[1])])
    for some in chunks(len(windows), whole[:1].nbytes):
        slope = whole[some] * weight[:, None]
        gram = slope.swapaxes(1, 2) @ slope + np.diag(precision)
        leverage[some] = np.einsum("wkl,wlk->wk", slope, np.linalg.solve(gram, slope.swapaxes(1, 2)))
    left = state.residual.reshape(windows.measured.shape)
    free = np.clip(1 - leverage.reshape(left.shape), 0.05, 1.0)
    noise = {}
    counts = windows.trust**2
    for column, channel in enumerate(windows.channels):
        seen = counts[..., column].sum(1) > 0
        freedom = (free[..., column] * counts[..., column])[seen].sum(1)
        if seen.any() and not freedom.sum() > LEAST_FREEDOM * counts[..., column].sum():
            continue
        squares = (left[seen][..., column] ** 2).sum(1) / freedom
        squares[~np.isfinite(squares)] = np.inf  # of a window that diverged
        size = np.sqrt(np.median(squares)) if seen.any() else 0.0  # the median: a few windows may be badly followed
        noise[channel] = float(max(size, windows.resolution[column] * ROUNDING, LEAST_NOISE))
    return noise


def first_noise(windows: Windows) -> dict[str, float]:
    """Rough white noise of each channel from third differences, which a smooth motion hardly has."""
    noise = {}
    for column, channel in enumerate(windows.channels):
        series = windows.measured[..., column]
        if channel in ANGLES:
            series = np.unwrap(series, axis=1)
        rows = zip(series, windows.trust[..., column] > 0, strict=True)
        third = np.concatenate([np.diff(window[seen], 3) for window, seen in rows if seen.sum() > 3] or [np.zeros(1)])
        scale = 1.4826 * np.median(np.abs(third)) / np.sqrt(20.0)
        floor = 1e-4 if CHANNELS.index(channel) < 6 else 1e-3
        noise[channel] = float(max(scale, floor, windows.resolution[column] * ROUNDING))
    return noise
