"""The minimum of a quadratic within bounds."""

import numpy as np
from scipy.linalg import get_lapack_funcs

from auv_torchrl.diagnosis.motion.windows import Floats

BOUND_PASSES = 4  # of fixing numbers at their bounds and fitting the rest again
POTRF, POTRS = get_lapack_funcs(("potrf", "potrs"), dtype=np.float64)  # Cholesky without scipy's checks of small arrays
SINGULAR = 1e-13  # of the largest direction: below, a double holds nothing but rounding


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
