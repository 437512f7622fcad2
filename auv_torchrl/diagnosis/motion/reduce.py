"""From windows full of samples to one small quadratic: what the log says about every change at once."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import get_lapack_funcs

from auv_torchrl.diagnosis.motion.actuation import actuate
from auv_torchrl.diagnosis.motion.rollout import DIVERGING
from auv_torchrl.diagnosis.motion.smooth import Layout, Smoothed, flown, noise_per_sample
from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.diagnosis.thresholds import DIVERGED
from auv_torchrl.vehicle import Vehicle

BOUND_PASSES = 4  # of fixing numbers at their bounds and fitting the rest again
POTRF, POTRS = get_lapack_funcs(("potrf", "potrs"), dtype=np.float64)  # Cholesky without scipy's checks of small arrays
SINGULAR = 1e-13  # of the largest direction: below, a double holds nothing but rounding
OU_TIME = 1.0  # s, correlation time of the disturbance force


@dataclass(frozen=True)
class Quadratic:
    """Chi-square of amounts ``a`` (N,) of columns: ``constant - 2 b a + a A a``, starts and disturbance fitted."""

    constant: float
    b: Floats  # (N,)
    A: Floats  # (N, N)
    numbers: int  # measured numbers

    def __add__(self, other: "Quadratic") -> "Quadratic":
        return Quadratic(
            self.constant + other.constant, self.b + other.b, self.A + other.A, self.numbers + other.numbers
        )


@dataclass(frozen=True)
class Parts:
    """What ``W`` windows add to a quadratic of ``N`` columns, as factors: one product of all windows is the fastest."""

    marks: Floats  # (W, K, 1 + N) residual and marks in units of the noise
    pull: Floats  # (W, L, 1 + N) of each of these on the free numbers
    moved: Floats  # (W, L, 1 + N) free numbers that fit each of them best
    constant: Floats  # (W,) chi-square that no column changes: of the prior, or of a window that diverged
    numbers: float  # measured numbers of all of them

    def windows(self, chosen: np.ndarray) -> Quadratic:
        """The quadratic of some windows (a boolean mask)."""
        return pooled([self], chosen)

    def pooled(self, chosen: np.ndarray) -> Floats:
        """Of some windows (W,): constant and b in the first row of (1 + N, 1 + N), A in the others."""
        marks, pull, moved = (
            (rows if chosen.all() else rows[chosen]).reshape(-1, rows.shape[-1])
            for rows in (self.marks, self.pull, self.moved)
        )
        whole = marks.T @ marks - pull.T @ moved
        whole[0, 0] += self.constant[chosen].sum()
        return whole


def pooled(pieces: Iterable[Parts], chosen: np.ndarray) -> Quadratic:
    """The quadratic of some of all windows (a boolean mask), whose parts come piece by piece, in order.

    A generator keeps no more than one piece in memory.
    """
    first, whole, numbers = 0, np.zeros((1, 1)), 0.0
    for piece in pieces:
        behind = first + len(piece.constant)
        whole = whole + piece.pooled(chosen[first:behind])
        numbers += piece.numbers
        first = behind
    return Quadratic(float(whole[0, 0]), whole[0, 1:], whole[1:, 1:], round(round(numbers) * chosen.mean()))


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
    precision[:starts, :starts] = np.diag(layout.loose**-2.0)
    precision[starts:, starts:] = disturbance_precision(layout, dt, floor)
    return precision


@dataclass(frozen=True)
class Freedom:
    """What the free start and the disturbance of every window can absorb; many explanations share one."""

    weight: Floats  # (K,) one over the noise of each number of a window
    slope: Floats  # (W, K, L) of the prediction in the free numbers, in units of the noise
    precision: Floats  # (L, L) prior of the free numbers
    inverse: Floats  # (W, L, L) posterior covariance of the free numbers

    @staticmethod
    @DIVERGING
    def of(windows: Windows, layout: Layout, slope: Floats, sigma: dict[str, float], prior: Floats) -> "Freedom":
        """Work it out for slopes (W, K, L), sensor noise by channel and a disturbance of ``prior`` (D,)."""
        weight = 1.0 / noise_per_sample(windows, sigma)
        scaled = slope * weight[:, None]
        precision = local_precision(layout, windows.dt, prior)
        return Freedom(weight, scaled, precision, np.linalg.inv(scaled.swapaxes(1, 2) @ scaled + precision))

    def away(self, windows: Windows, layout: Layout, start: Floats, bins: Floats) -> Floats:
        """Free numbers (W, R, L) of starts (W, R, 12) and bins (W, R, B, D), less what the prior expects."""
        moved = (start - windows.guess[:, None])[..., layout.start]
        return np.concatenate([moved, bins.reshape(*bins.shape[:2], -1)], axis=-1)

    def rows(self, some: slice) -> "Freedom":
        """That of some windows."""
        return replace(self, slope=self.slope[some], inverse=self.inverse[some])

    def determined(self, layout: Layout) -> float:
        """How many entries of all starts the samples tell; an axis that nobody measured costs no number."""
        at = np.arange(len(layout.start))
        told = 1.0 - self.inverse[:, at, at] * self.precision[at, at]
        return float(np.where(np.isfinite(told), told, 1.0).sum())


@DIVERGING
def settle(
    windows: Windows,
    vehicle: Vehicle,
    layout: Layout,
    freedom: Freedom,
    start: Floats,
    bins: Floats,
    residual: Floats | None = None,
    steps: int = 1,
) -> tuple[Floats, Floats, Floats, Floats]:
    """Gauss-Newton steps of the free numbers; starts, bins, residuals (W, R, K) and states (W, R, S + 1, 13) then.

    ``vehicle`` is a batch (R,), ``start`` (W, R, 12), ``bins`` (W, R, B, D); ``residual`` is theirs where it is known.
    Slopes are known: they hardly change where a small change of the vehicle moves the windows a little.
    """
    actuation = actuate(windows, vehicle)
    states = np.empty(0)
    if residual is None:
        residual, states = flown(actuation, layout, start, bins)
    for _ in range(steps):
        pull = (residual * freedom.weight) @ freedom.slope
        pull -= freedom.away(windows, layout, start, bins) @ freedom.precision
        move = pull @ freedom.inverse  # symmetric
        start = start.copy()
        start[..., layout.start] += move[..., : len(layout.start)]
        bins = bins + move[..., len(layout.start) :].reshape(bins.shape)
        residual, states = flown(actuation, layout, start, bins)
    return start, bins, residual, states


@DIVERGING
def chi_square(
    windows: Windows, layout: Layout, freedom: Freedom, start: Floats, bins: Floats, residual: Floats
) -> Floats:
    """Chi-square (W, R) of what :func:`settle` returned, the free numbers paid for."""
    away = freedom.away(windows, layout, start, bins)
    scaled = residual * freedom.weight
    pull = scaled @ freedom.slope - away @ freedom.precision
    parts = (
        (scaled**2).sum(-1) + ((away @ freedom.precision) * away).sum(-1) - ((pull @ freedom.inverse) * pull).sum(-1)
    )
    return np.where(np.isfinite(parts), parts, DIVERGED)


@DIVERGING
def reduce(windows: Windows, layout: Layout, freedom: Freedom, state: Smoothed, columns: Floats) -> Parts:
    """Eliminate the start and the disturbance of every window.

    Args:
        windows: the data.
        layout: of the free numbers of ``state``.
        freedom: what they can absorb.
        state: where the slopes were taken; its force is part of the gap, not of the disturbance.
        columns: (W, K, N) marks of the changes.
    """
    away = freedom.away(windows, layout, state.start[:, None], state.bins[:, None])[:, 0]
    marks = np.concatenate([state.residual[..., None], columns], axis=2) * freedom.weight[:, None]
    pull = freedom.slope.swapaxes(1, 2) @ marks
    pull[..., 0] -= away @ freedom.precision
    moved = freedom.inverse @ pull
    constant = ((away @ freedom.precision) * away).sum(-1)
    size = constant + np.einsum("wkn,wkn->w", marks, marks) + np.einsum("wln,wln->w", pull, moved)
    diverged = ~np.isfinite(size)
    marks[diverged], pull[diverged], moved[diverged], constant[diverged] = 0.0, 0.0, 0.0, DIVERGED
    return Parts(marks, pull, moved, constant, windows.numbers - freedom.determined(layout))


def solve_semidefinite(H: Floats, right: Floats) -> Floats:
    """The shortest ``x`` (N,) or (N, M) with ``H x = right``, of a symmetric ``H`` (N, N) without negative directions.

    Cholesky where ``H`` is far from singular, which is seven times as fast, singular values elsewhere.
    """
    factor, failed = POTRF(H, lower=1, clean=0)
    if not failed and len(H):
        diagonal = np.diagonal(factor)
        if diagonal.min() > SINGULAR**0.5 * diagonal.max():
            return POTRS(factor, right, lower=1)[0]
    return np.linalg.lstsq(H, right, rcond=SINGULAR)[0]


def bounded_minimum(
    H: Floats, g: Floats, low: Floats, high: Floats, x: Floats | None = None, free: np.ndarray | None = None
) -> Floats:
    """Minimum (N,) of ``x H x - 2 g x`` within bounds: what a number at its bound leaves goes to the others.

    Numbers that are not ``free`` stay as they are in ``x``.
    """
    x = np.zeros(len(g)) if x is None else x.copy()
    free = np.ones(len(g), bool) if free is None else free.copy()
    for _ in range(BOUND_PASSES):
        if free.all():
            x = solve_semidefinite(H, g)
        else:
            rows = H[free]
            x[free] = solve_semidefinite(rows[:, free], g[free] - rows[:, ~free] @ x[~free])
        beyond = free & ((x < low) | (x > high))
        if not beyond.any():
            break
        x[beyond] = np.clip(x, low, high)[beyond]
        free &= ~beyond
    return np.clip(x, low, high)
