"""The minimum of a quadratic within bounds, without a search for the exact one.

Two forms serve the diagnosis, and none replaces the other:

- :func:`bounded_minimum` ranks candidates. It clips all numbers beyond their bounds at once and fits the others again:
  faster than the path, at a cost that may be far above the least.
- :func:`least_within` makes the steps of a fit. It follows a path from the start to the minimum and never leaves the
  bounds. Where numbers can replace each other, a minimum that is clipped afterwards is no step downhill: the mass that
  made up for a negative added mass is wrong once the added mass is clipped to 0.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from auv_torchrl.sysid.model import Floats

BOUND_PASSES = 4  # of clipping numbers to their bounds and fitting the others again
SINGULAR = 1e-13  # of the largest direction: below, a double holds nothing but rounding
STILL = 1e-3  # of the largest step, each in units of its curvature: a number at a bound that moves less is rounding
TINY = 1e-300  # curvature of a number that acts on nothing


@cache
def _cholesky() -> tuple[Callable[..., Any], Callable[..., Any]]:
    """LAPACK's factor and solution by it, without scipy's checks of small arrays."""
    from scipy.linalg import get_lapack_funcs  # here: it takes long to import

    potrf, potrs = get_lapack_funcs(("potrf", "potrs"), dtype=np.float64)
    return potrf, potrs


def solve_semidefinite(H: Floats, right: Floats) -> Floats:
    """The shortest ``x`` (N,) or (N, M) with ``H x = right``, of a symmetric ``H`` (N, N) without negative directions.

    Cholesky where ``H`` is far from singular, which is seven times as fast, singular values elsewhere. Numbers of
    different units do not make it singular: each is taken in units of its curvature.
    """
    potrf, potrs = _cholesky()
    curvature = np.diagonal(H)
    if len(H) and curvature.min() > TINY:
        size = np.sqrt(curvature)
        factor, failed = potrf(H / size / size[:, None], lower=1, clean=0)
        if not failed and np.diagonal(factor).min() > SINGULAR**0.5:
            units = size if right.ndim == 1 else size[:, None]
            return potrs(factor, right / units, lower=1)[0] / units
    return np.linalg.lstsq(H, right, rcond=SINGULAR)[0]


def bounded_minimum(
    H: Floats, g: Floats, low: Floats, high: Floats, x: Floats | None = None, free: np.ndarray | None = None
) -> Floats:
    """A point (N,) within bounds where ``x H x - 2 g x`` is low: numbers beyond a bound stop there, others go on.

    Numbers that are not ``free`` keep their value in ``x``.
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


def least_within(
    H: Floats, g: Floats, bounds: tuple[Floats, Floats], directions: Floats, start: Floats | None = None
) -> Floats:
    """Where (k,) ``x H x - 2 g x`` is least along directions (k, g) from a start, on a path within ``bounds`` (k,).

    A number that reaches a bound on the path stays there while the others go on. The start is 0 unless it is given.
    """
    # By the size alone: a curvature that is lost in what it was made of by subtraction may come out below 0.
    size, x = np.sqrt(np.maximum(np.abs(np.diag(H)), TINY)), np.zeros(len(g)) if start is None else start.copy()
    low, high = bounds
    even = H / np.outer(size, size)
    while directions.shape[1]:
        scaled = directions * size[:, None]
        step = directions @ solve_semidefinite(scaled.T @ even @ scaled, directions.T @ (g - H @ x))
        goes = np.abs(step * size) > STILL * np.abs(step * size).max()
        room = np.maximum(np.where(step > 0, high - x, x - low), 0.0)
        share = np.where(goes, room / np.where(goes, np.abs(step), 1.0), np.inf)
        stops = int(np.argmin(share))
        x = x + min(float(share[stops]), 1.0) * step
        if share[stops] >= 1:
            break
        directions = _without(directions, stops)
    return np.clip(x, low, high)


def _without(directions: Floats, stopped: int) -> Floats:
    """The directions (k, g - 1) among directions (k, g) along which one number stays."""
    row = directions[stopped]
    (moves,) = np.nonzero(row)
    if len(moves) == 1:  # a number for itself
        return np.delete(directions, moves[0], axis=1)
    return directions @ np.linalg.svd(row[None])[2][1:].T


def minimum_within(H: Floats, g: Floats, bounds: tuple[Floats, Floats], x: Floats, free: np.ndarray) -> Floats:
    """:func:`least_within` from ``x`` (k,) in the ``free`` numbers, by one solution where no bound is met."""
    whole = x.copy()
    whole[free] = solve_semidefinite(H[np.ix_(free, free)], g[free] - H[np.ix_(free, ~free)] @ x[~free])
    if ((whole >= bounds[0]) & (whole <= bounds[1]))[free].all():
        return whole
    low, high = (np.where(free, bound, x) for bound in bounds)
    return least_within(H, g, (low, high), np.eye(len(g))[:, free], x)
