"""Means and medians along a window that moves with its middle; numpy's, as scipy.ndimage takes long to import."""

from typing import Literal

import numpy as np

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


def rolling_mean(values: np.ndarray, size: int, ends: Ends = "symmetric") -> np.ndarray:
    """The mean (T,) of the ``size`` values around each of (T,), an odd number; ``ends`` makes those beyond."""
    return _windows(values, size, ends).mean(axis=-1)


def _windows(values: np.ndarray, size: int, ends: Ends) -> np.ndarray:
    assert size % 2
    return np.lib.stride_tricks.sliding_window_view(np.pad(values, size // 2, mode=ends), size)
