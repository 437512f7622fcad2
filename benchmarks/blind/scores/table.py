"""Shares with intervals, calibration, and the tables and cells of the report that show them."""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

Z_95 = 1.959964


class Share(NamedTuple):
    """``hits`` out of ``n`` with its 95 % Wilson interval (Wilson 1927)."""

    hits: int
    n: int

    @staticmethod
    def of(outcomes: Iterable[bool | None]) -> "Share":
        """Count the outcomes that are true; None is no outcome."""
        known = [outcome for outcome in outcomes if outcome is not None]
        return Share(sum(known), len(known))

    @property
    def value(self) -> float:
        """The share; NaN of nothing."""
        return self.hits / self.n if self.n else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """Low and high end; everything where nothing was counted."""
        if not self.n:
            return 0.0, 1.0
        z2 = Z_95**2
        centre = (self.hits + z2 / 2) / (self.n + z2)
        half = Z_95 / (self.n + z2) * math.sqrt(self.hits * (self.n - self.hits) / self.n + z2 / 4)
        return max(0.0, centre - half), min(1.0, centre + half)

    @property
    def fraction(self) -> str:
        """Without the interval; empty where nothing was counted."""
        return f"{self.hits}/{self.n}" if self.n else ""

    def __str__(self) -> str:
        if not self.n:
            return "–"
        low, high = self.interval
        return f"{self.value:.1%} ({self.hits}/{self.n}, {low:.0%} to {high:.0%})"


class Bin(NamedTuple):
    """Answers of similar probability."""

    probability: float  # mean
    right: Share


def reliability(probability: Sequence[float], right: Sequence[bool], bins: int = 10) -> list[Bin]:
    """Answers in bins of equal width, empty ones left out."""
    p, hit = np.asarray(probability, dtype=float), np.asarray(right, dtype=bool)
    index = np.minimum((p * bins).astype(int), bins - 1)
    return [Bin(float(p[index == i].mean()), Share.of(hit[index == i].tolist())) for i in np.unique(index)]


def calibration_error(bins: Sequence[Bin]) -> float:
    """Expected calibration error: mean distance of probability and accuracy, weighted by count (Guo et al. 2017)."""
    total = sum(b.right.n for b in bins)
    return sum(b.right.n * abs(b.probability - b.right.value) for b in bins) / total if total else math.nan


def quantile(values: Sequence[float], q: float) -> float:
    """Quantile; NaN of nothing."""
    return float(np.quantile(values, q)) if len(values) else math.nan


def median(values: Sequence[float]) -> float:
    """Median; NaN of nothing."""
    return quantile(values, 0.5)


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
