"""Notice that a vehicle has changed: a cumulative sum test whose false-alarm rate is calculated, not tuned."""

from functools import cache
from typing import Any

import numpy as np
from scipy.special import chdtr, chdtri  # of chi-square; scipy.stats has them too, and takes a second to import

Array = Any
_CELLS = 120  # of the sum's range in the calculation of the run length
_LARGEST = 50  # caps; a test with a larger threshold would never see anything


class ChangeDetector:
    """Cumulative sum (Page 1954) of squared innovations, one per vehicle.

    While the estimate describes the vehicle, the squared innovation of m measured values is chi-square with m
    degrees of freedom, whatever the vehicle does. The sum grows by it less m + shift^2 / 2, never below 0; beyond
    :attr:`threshold` the vehicle has changed. The threshold gives the wanted mean time between false alarms, from
    the Markov chain of the sum (Brook and Evans 1972).

    Args:
        degrees: measured values per step.
        smallest_shift: norm of the shift of the innovation, in standard deviations, that the test is tuned for.
        steps_between_false_alarms: mean number of healthy steps between two alarms.
        capped_share: share of the healthy steps whose square is cut off.
    """

    def __init__(self, degrees: int, smallest_shift: float, steps_between_false_alarms: float, capped_share: float):
        self.reference = degrees + smallest_shift**2 / 2
        self.degrees = degrees
        self.cap = float(chdtri(degrees, capped_share))
        self.threshold = _threshold(degrees, self.reference, self.cap, steps_between_false_alarms)

    def advance(self, total: Array, square: Array, usable: Array) -> Array:
        """The sums (N,) after squared innovations (N,); rows that are not ``usable`` keep theirs."""
        grown = np.maximum(0.0, total + np.minimum(square, self.cap) - self.reference)
        return np.where(usable, grown, total)


@cache
def _threshold(degrees: int, reference: float, cap: float, steps: float) -> float:
    low = high = reference
    while 0 < _run_length(degrees, reference, cap, high) < steps:
        low, high = high, 1.25 * high
        if high > _LARGEST * cap:
            raise ValueError(
                f"detector: one false alarm in {steps:g} steps is not reached with a reference of {reference:g} for "
                f"{degrees} values: give a larger smallest_shift"
            )
    for _ in range(20):
        middle = (low + high) / 2
        low, high = (middle, high) if _run_length(degrees, reference, cap, middle) < steps else (low, middle)
    return high


def _run_length(degrees: int, reference: float, cap: float, threshold: float) -> float:
    """Mean number of healthy steps until the sum, from 0, exceeds ``threshold``; not above 0 where numbers end."""
    width = threshold / _CELLS
    # from the centre of cell i a step ends below the upper edge of cell j; cell 0 takes all that is below it
    edge = (np.arange(-_CELLS, _CELLS) + 0.5) * width + reference
    below = np.where(edge < cap, chdtr(degrees, np.maximum(edge, 0.0)), 1.0)
    cell = np.arange(_CELLS)
    stay = np.diff(below[_CELLS + cell[None, :] - cell[:, None]], axis=1, prepend=0.0)
    return float(np.linalg.solve(np.eye(_CELLS) - stay, np.ones(_CELLS))[0])
