"""Slopes of windows, the largest arrays of a diagnosis: the latest are held, the others are worked out again."""

import weakref
from collections.abc import Callable, Iterator

import numpy as np

from auv_torchrl.diagnosis.motion.windows import Floats

# Bytes of all slopes that are held, beside those in use. A minute of flight has 2 to 10 MB of them, and 20 MB of 15
# channels under a limit cycle. A search compares a dozen explanations.
HELD = 128 << 20
AT_ONCE = 24 << 20  # bytes of an array over windows; what is made of one takes several times as much
# Bytes of the slopes of all windows of a log. A diagnosis takes up to ten times as much at its worst, beside 0.5 GB of
# libraries, and 1.5 GB are what it may in all. Of 15 channels at 20 Hz that is 5 minutes, with two forces per bin.
MOST = 96 << 20
WHITENING = 0.35  # share that counts of what whitens the samples: slopes are in use ten times, this is three times
FEWEST = 12  # windows, however large


class Slopes:
    """Slopes (W, K, L) of windows in their free numbers, which are let go where others need the memory."""

    def __init__(self, make: Callable[[], Floats], array: Floats | None = None, counts: bool = True) -> None:
        self._make = make
        self._array = array
        self._counts = counts
        if array is not None:
            self._hold()

    @property
    def array(self) -> Floats:
        """The slopes, worked out again where they were let go. Nobody changes them in place."""
        array = self._make() if self._array is None else self._array
        if self._counts:
            self._array = array
            self._hold()
        return array

    @property
    def is_held(self) -> bool:
        """Whether they are in memory."""
        return self._array is not None

    def rows(self, some: slice | np.ndarray) -> "Slopes":
        """Those of some windows, taken from the whole when they are asked for."""
        return Slopes(lambda: self.array[some], counts=False)

    def taken(self) -> Floats:
        """The slopes for somebody who changes them in place; these are let go."""
        array, self._array = self.array, None
        return array if self._counts else array.copy()

    def _hold(self) -> None:
        """Be the latest of all that are held, and let the oldest go where these are too large."""
        if not self._counts:
            return
        _latest.pop(id(self), None)
        _latest[id(self)] = weakref.ref(self)
        held = {key: slopes for key, known in _latest.items() if (slopes := known()) is not None}
        sizes = {key: slopes._array.nbytes for key, slopes in held.items() if slopes._array is not None}
        total = sum(sizes.values())
        for key in [key for key in _latest if key != id(self)]:
            if key not in sizes or total > HELD:
                total -= sizes.get(key, 0)
                if key in held:
                    held[key]._array = None
                del _latest[key]


_latest: dict[int, "weakref.ref[Slopes]"] = {}  # the latest asked for is the last


def affordable(numbers: int, free: int, coloured: bool) -> int:
    """How many windows of so many ``numbers`` fit the memory, with as many ``free`` ones in each.

    Where errors are ``coloured``, what whitens the numbers is held beside: once, where slopes are in use many times.
    """
    each = 8 * numbers * (free + (WHITENING * numbers if coloured else 0.0))
    return max(FEWEST, int(MOST / each))


def chunks(windows: int, each: int, most: int = AT_ONCE) -> Iterator[slice]:
    """Slices of windows of ``each`` bytes, all about as long, of which none takes more than ``most`` bytes."""
    count = min(windows, -(-windows * each // most)) or 1
    edges = np.linspace(0, windows, count + 1).astype(int).tolist()
    return (slice(first, behind) for first, behind in zip(edges, edges[1:], strict=False))
