"""From windows full of samples to one small quadratic: what the log says about every change at once."""

from dataclasses import dataclass

import numpy as np

from auv_torchrl.diagnosis.rollout import DIVERGING
from auv_torchrl.diagnosis.smooth import LOOSE_START, Layout, Smoothed, noise_per_sample
from auv_torchrl.diagnosis.windows import Floats, Windows

DIVERGED = 1e5  # chi-square of a window in which the vehicle flies off
OU_TIME = 1.0  # s, correlation time of the disturbance force


@dataclass(frozen=True)
class Quadratic:
    """Chi-square of amounts ``a`` (N,) of columns: ``constant - 2 b a + a A a``, starts and disturbance fitted.

    The sums run over windows; ``by_window`` keeps the parts, for change points and held-out windows.
    """

    constant: float
    b: Floats  # (N,)
    A: Floats  # (N, N)
    constant_by_window: Floats  # (W,)
    b_by_window: Floats  # (W, N)
    A_by_window: Floats  # (W, N, N)
    numbers: int  # measured numbers

    def windows(self, chosen: np.ndarray) -> "Quadratic":
        """The quadratic of some windows (a boolean mask)."""
        share = chosen.mean()
        constant, b, A = self.constant_by_window[chosen], self.b_by_window[chosen], self.A_by_window[chosen]
        return Quadratic(constant.sum(), b.sum(0), A.sum(0), constant, b, A, round(self.numbers * share))


def disturbance_precision(layout: Layout, dt: float, size: Floats) -> Floats:
    """Inverse covariance (B D, B D) of a first-order Gauss-Markov force of standard deviation ``size`` (D,)."""
    age = np.arange(layout.bins) * layout.steps_per_bin * dt
    correlation = np.exp(-np.abs(age[:, None] - age) / OU_TIME)
    inverse = np.linalg.inv(correlation)
    return np.kron(inverse, np.diag(size**-2.0))


def local_precision(layout: Layout, dt: float, floor: Floats) -> Floats:
    """Inverse prior covariance (L, L) of the free numbers of a window."""
    starts = len(layout.start)
    precision = np.zeros((layout.size, layout.size))
    precision[:starts, :starts] = np.diag(LOOSE_START[layout.start] ** -2.0)
    precision[starts:, starts:] = disturbance_precision(layout, dt, floor)
    return precision


@DIVERGING
def reduce(
    windows: Windows,
    layout: Layout,
    state: Smoothed,
    columns: Floats,
    sigma: dict[str, float],
    floor: Floats,
) -> Quadratic:
    """Eliminate the start and the disturbance of every window.

    Args:
        windows: the data.
        layout: of the free numbers of ``state``.
        state: where the slopes were taken; its force is part of the gap, not of the disturbance.
        columns: (W, K, N) marks of the changes.
        sigma: sensor noise by channel.
        floor: (D,) standard deviation of the disturbance force.
    """
    weight = 1.0 / noise_per_sample(windows, sigma)
    slope = state.slope * weight[:, None]
    starts = len(layout.start)
    precision = local_precision(layout, windows.dt, floor)
    away = np.concatenate([(state.start - windows.guess)[:, layout.start], state.bins.reshape(len(windows), -1)], 1)
    right = np.concatenate([(state.residual * weight)[..., None], columns * weight[:, None]], axis=2)  # (W, K, 1 + N)
    gram = slope.swapaxes(1, 2) @ slope + precision
    cross = slope.swapaxes(1, 2) @ right
    cross[..., 0] -= away @ precision
    inner = right.swapaxes(1, 2) @ right - cross.swapaxes(1, 2) @ np.linalg.solve(gram, cross)
    inner[:, 0, 0] += np.einsum("wl,lm,wm->w", away, precision, away)
    diverged = ~np.isfinite(inner).all((1, 2))
    inner[diverged] = 0.0
    inner[diverged, 0, 0] = DIVERGED
    whole = inner.sum(0)
    numbers = int(windows.present.sum()) * len(windows.channels) - len(windows) * starts
    return Quadratic(
        float(whole[0, 0]), whole[0, 1:], whole[1:, 1:], inner[:, 0, 0], inner[:, 0, 1:], inner[:, 1:, 1:], numbers
    )
