"""What is made of things that nobody changes, and asked for again and again."""

from collections.abc import Callable, Hashable
from math import inf
from typing import Generic, TypeVar

T = TypeVar("T")


class Latest(Generic[T]):
    """The latest few results, each found by the very objects that it was made of."""

    def __init__(self, kept: int, most: float = inf, size: Callable[[T], int] = lambda result: 0) -> None:
        """At most ``kept`` of them, and no more but the latest than ``most`` bytes of the ``size`` of each."""
        self._kept, self._most, self._size = kept, most, size
        self._made: dict[Hashable, tuple[tuple[object, ...], T]] = {}  # the latest asked for is the last

    def of(self, make: Callable[[], T], given: tuple[object, ...], key: Hashable = None) -> T:
        """What ``make`` makes of these very objects ``given``, at equal keys; they are not changed afterwards."""
        place = *map(id, given), key  # which holds while they are kept
        found = self._made.pop(place, None) or (given, make())
        self._made[place] = found
        while len(self._made) > 1 and (len(self._made) > self._kept or (self._most < inf and self._bytes > self._most)):
            del self._made[next(iter(self._made))]
        return found[1]

    @property
    def _bytes(self) -> int:
        return sum(self._size(result) for _, result in self._made.values())

    def clear(self) -> None:
        """Give back the memory."""
        self._made.clear()
