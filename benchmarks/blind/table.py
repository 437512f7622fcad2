"""Tables of the report, and what stands in cells of several of them."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

from benchmarks.blind.statistics import median


class Table(NamedTuple):
    """A table with a title."""

    title: str
    head: tuple[str, ...]
    rows: list[tuple[str, ...]]


def targets(title: str, rows: Iterable[tuple[str, str, str, Any]]) -> Table:
    """What the project asks for with what was measured; rows are claim, must, aim and measured."""
    head = ("", "must", "aim", "measured (95 % interval)")
    return Table(title, head, [(*row[:3], str(row[3])) for row in rows])


def number(values: Sequence[float], of: Callable[[Sequence[float]], float], form: str) -> str:
    """A number that some values have together, and how many they are."""
    return f"{of(values):{form}} (n = {len(values)})" if values else "–"


def median_and_largest(seconds: Sequence[float]) -> str:
    """Both of the times that logs took."""
    return f"{median(seconds):.1f} / {max(seconds):.1f}" if seconds else "–"


def counted(names: Iterable[str]) -> str:
    """Each name with how often it is there, the most frequent first."""
    return ", ".join(f"{name} {n}" for name, n in Counter(names).most_common())
