"""What is made of things that nobody changes, and asked for again and again."""

from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

T = TypeVar("T")


class Latest(Generic[T]):
    """The latest few results, each found by the very objects that it was made of."""

    def __init__(self, kept: int) -> None:
        self._kept = kept
        self._made: dict[Hashable, tuple[tuple[object, ...], T]] = {}  # the latest asked for is the last

    def of(self, make: Callable[[], T], given: tuple[object, ...], key: Hashable = None) -> T:
        """What ``make`` makes of these very objects ``given``, at equal keys; they are not changed afterwards."""
        place = *map(id, given), key  # which holds while they are kept
        found = self._made.pop(place, None) or (given, make())
        self._made[place] = found
        while len(self._made) > self._kept:
            del self._made[next(iter(self._made))]
        return found[1]

    def clear(self) -> None:
        """Give back the memory."""
        self._made.clear()
