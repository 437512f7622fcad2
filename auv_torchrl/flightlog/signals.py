"""Moving medians and means, integrals and runs of columns (T,) or (T, k); by numpy, as scipy takes long to import."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ends = Literal["edge", "reflect", "symmetric"]  # see numpy.pad
_AT_ONCE = 2**20  # windows, each of which is copied


def rolling_median(values: np.ndarray, size: int, ends: Ends = "edge") -> np.ndarray:
    """The median (T,) of the ``size`` values around each of (T,), an odd number; ``ends`` makes those beyond.

    Fewer values than ``size`` stay as they are.
    """
    if len(values) < size:
        return values
    windows = _windows(values, size, ends)
    parts = np.array_split(windows, 1 + len(values) // _AT_ONCE)
    return np.concatenate([np.partition(part, size // 2, axis=-1)[:, size // 2] for part in parts])


def rolling_mean(values: np.ndarray, size: int) -> np.ndarray:
    """The mean (T,) of the ``size`` values around each of (T,), an odd number; mirrored beyond the ends."""
    return _windows(values, size, "symmetric").mean(axis=-1)


def _windows(values: np.ndarray, size: int, ends: Ends) -> np.ndarray:
    assert size % 2
    return np.lib.stride_tricks.sliding_window_view(np.pad(values, size // 2, mode=ends), size)


def integral(t: Floats, values: Floats, held: bool = False) -> Floats:
    """Integral (T, k) of values (T, k) from the first time on: linear between samples, or held until the next one."""
    area = values[:-1] if held else (values[:-1] + values[1:]) / 2
    return np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(area * np.diff(t)[:, None], axis=0)])


def interpolate(at: Floats, t: Floats, values: Floats) -> Floats:
    """Columns (B, k) at the times ``at`` (B,), linear between samples (T, k)."""
    return np.stack([np.interp(at, t, column) for column in values.T], axis=-1)


def runs(mask: np.ndarray) -> np.ndarray:
    """Where a mask (T,) is True: the first of each run and the first behind it, (R, 2)."""
    return np.flatnonzero(np.diff(np.concatenate([[0], mask, [0]]))).reshape(-1, 2)
