"""Starts and disturbances integrated out of all windows: one small quadratic in the amounts of all changes is left.

A column is the response of the samples to one change of the vehicle. The free numbers of a window, its start and its
disturbance, absorb a part of every column. What remains of all columns makes the quadratic.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from auv_torchrl.diagnosis.motion.actuation import actuate
from auv_torchrl.diagnosis.motion.rollout import DIVERGING
from auv_torchrl.diagnosis.motion.smooth import Layout, Smoothed, flown, noise_per_sample
from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.diagnosis.thresholds import DIVERGED
from auv_torchrl.vehicle import Vehicle

OU_TIME = 1.0  # s, correlation time of the disturbance force


@dataclass(frozen=True)
class Reduced:
    """Columns on ``W`` windows, and the part of each that the free numbers of a window absorb."""

    responses: Floats  # (W, K, N) in units of the noise
    pull: Floats  # (W, L, N) of each of these on the free numbers
    moved: Floats  # (W, L, N) free numbers that fit each of them best
    _squares: dict[bytes, Floats] = field(default_factory=dict, repr=False)

    def rows(self, some: slice) -> "Reduced":
        """That of some windows."""
        if some == slice(0, len(self.responses)):
            return self
        return Reduced(self.responses[some], self.pull[some], self.moved[some])

    @cached_property
    def size(self) -> Floats:
        """A number (W,) per window, finite where all its numbers are."""
        return np.einsum("wkn,wkn->w", self.responses, self.responses) + np.einsum("wln,wln->w", self.pull, self.moved)

    def times(self, other: "Reduced", chosen: np.ndarray) -> Floats:
        """Products (N, M) with other columns over some windows (a boolean mask), the free numbers fitted."""
        mine, its, pull, moved = (
            (rows if chosen.all() else rows[chosen]).reshape(-1, rows.shape[-1])
            for rows in (self.responses, other.responses, self.pull, other.moved)
        )
        return mine.T @ its - pull.T @ moved

    def squares(self, chosen: np.ndarray) -> Floats:
        """Products (N, N) of the columns with each other, computed once for the same windows."""
        key = chosen.tobytes()
        if key not in self._squares:
            self._squares[key] = self.times(self, chosen)
        return self._squares[key]


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
    """Contribution of ``W`` windows to a quadratic of ``N`` columns, as factors: one product of all is the fastest."""

    columns: Reduced  # the residual, then the columns but for the first ones
    first: Reduced | None  # columns that are known already
    constant: Floats  # (W,) chi-square that no column changes: of the prior, or of a window that diverged
    diverged: np.ndarray  # (W,) bool
    numbers: float  # measured numbers of all of them

    @property
    def by_window(self) -> tuple[Floats, np.ndarray]:
        """Constant, b and A (W, 1 + N, 1 + N) of each window as in :meth:`pooled`, and which of them (W,) are finite.

        Of columns of which none is known already.
        """
        own = self.columns
        whole = own.responses.swapaxes(1, 2) @ own.responses - own.pull.swapaxes(1, 2) @ own.moved
        finite = ~self.diverged & np.isfinite(whole).all((1, 2))
        whole[:, 0, 0] += self.constant
        return whole, finite

    def windows(self, chosen: np.ndarray) -> Quadratic:
        """The quadratic of some windows (a boolean mask)."""
        return pooled([self], chosen)

    def pooled(self, chosen: np.ndarray) -> Floats:
        """Sum (1 + N, 1 + N) over some windows (W,): constant and b in the first row, A in the others."""
        finite = chosen & ~self.diverged
        whole = self.columns.times(self.columns, finite)
        if self.first is not None:
            across = self.first.times(self.columns, finite)  # (k, 1 + N - k)
            corner = self.first.squares(finite)
            upper = np.concatenate([whole[:1, :1], across[:, :1].T, whole[:1, 1:]], axis=1)
            middle = np.concatenate([across[:, :1], corner, across[:, 1:]], axis=1)
            lower = np.concatenate([whole[1:, :1], across[:, 1:].T, whole[1:, 1:]], axis=1)
            whole = np.concatenate([upper, middle, lower])
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
    """The free start and the disturbance of every window, as what they can absorb; many hypotheses share one."""

    weight: Floats  # (K,) one over the noise of each number of a window
    slope: Floats  # (W, K, L) of the prediction in the free numbers, in units of the noise
    precision: Floats  # (L, L) prior of the free numbers
    inverse: Floats  # (W, L, L) posterior covariance of the free numbers

    @staticmethod
    @DIVERGING
    def of(windows: Windows, layout: Layout, slope: Floats, sigma: dict[str, float], prior: Floats) -> "Freedom":
        """From slopes (W, K, L), sensor noise by channel and a disturbance of standard deviation ``prior`` (D,)."""
        weight = 1.0 / noise_per_sample(windows, sigma)
        scaled = slope * weight[:, None]
        precision = local_precision(layout, windows.dt, prior)
        return Freedom(weight, scaled, precision, np.linalg.inv(scaled.swapaxes(1, 2) @ scaled + precision))

    @property
    def size(self) -> int:
        """Bytes in memory."""
        return self.slope.nbytes + self.inverse.nbytes

    @DIVERGING
    def reduced(self, columns: Floats) -> Reduced:
        """Responses (W, K, N) to changes, and the part of them that the free numbers absorb."""
        responses = columns * self.weight[:, None]
        pull = self.slope.swapaxes(1, 2) @ responses
        return Reduced(responses, pull, self.inverse @ pull)

    def rows(self, some: slice) -> "Freedom":
        """That of some windows."""
        return replace(self, slope=self.slope[some], inverse=self.inverse[some])

    def determined(self, layout: Layout) -> float:
        """How many entries of all starts the samples determine; an axis without a channel costs no number."""
        at = np.arange(len(layout.start))
        share = 1.0 - self.inverse[:, at, at] * self.precision[at, at]
        return float(np.where(np.isfinite(share), share, 1.0).sum())


@dataclass(frozen=True)
class NuisanceResponses:
    """Responses to the nuisance parameters, per unit, and the part of them that the free numbers absorb."""

    freedom: Freedom
    reduced: Reduced

    def under(self, freedom: Freedom) -> Reduced:
        """The same responses where the free numbers absorb another part."""
        if freedom is self.freedom:
            return self.reduced
        return freedom.reduced(self.reduced.responses / self.freedom.weight[:, None])


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

    ``vehicle`` is a batch (R,), ``start`` (W, R, 12), ``bins`` (W, R, B, D); ``residual`` is known or
    None. The slopes of ``freedom`` serve: a small change of the vehicle hardly changes them.
    """
    actuation = actuate(windows, vehicle)
    states = np.empty(0)
    if residual is None:
        residual, states = flown(actuation, layout, start, bins)
    for _ in range(steps):
        pull = (residual * freedom.weight) @ freedom.slope
        pull -= layout.away(windows, start, bins) @ freedom.precision
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
    """Chi-square (W, R) of a result of :func:`settle`, with the cost of the free numbers."""
    away = layout.away(windows, start, bins)
    scaled = residual * freedom.weight
    pull = scaled @ freedom.slope - away @ freedom.precision
    parts = (
        (scaled**2).sum(-1) + ((away @ freedom.precision) * away).sum(-1) - ((pull @ freedom.inverse) * pull).sum(-1)
    )
    return np.where(np.isfinite(parts), parts, DIVERGED)


@DIVERGING
def reduce(
    windows: Windows,
    layout: Layout,
    freedom: Freedom,
    state: Smoothed,
    columns: Floats,
    first: Reduced | None = None,
) -> Parts:
    """Integrate the start and the disturbance out of every window.

    Args:
        windows: the data.
        layout: of the free numbers of ``state``.
        freedom: what the free numbers can absorb.
        state: where the slopes were taken; its force is part of the gap, not of the disturbance.
        columns: (W, K, N) responses to the changes.
        first: responses to other changes, which come before these and are reduced already.
    """
    away = layout.away(windows, state.start, state.bins)
    prior = away @ freedom.precision
    found = freedom.reduced(np.concatenate([state.residual[..., None], columns], axis=2))
    found.pull[..., 0] -= prior
    found.moved[..., 0] = (freedom.inverse @ found.pull[..., :1])[..., 0]
    constant = (prior * away).sum(-1)
    diverged = ~np.isfinite(constant + found.size + (0.0 if first is None else first.size))
    constant[diverged] = DIVERGED
    return Parts(found, first, constant, diverged, windows.numbers - freedom.determined(layout))
