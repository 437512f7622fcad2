"""The entries of one column of a table as float64: numbers, dates and clocks, and what is none of them.

Numbers are written in ASCII digits. A date (ISO 8601, with or without a zone) becomes seconds since 1970, a clock
seconds since midnight.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from auv_torchrl.flightlog.log import Floats
from auv_torchrl.text import printable

LARGEST = 1e19  # beyond nanoseconds since 1970 and any unit of length; its square still is a number
_EXAMPLES = 3  # entries that a message quotes
_QUOTED = 20  # characters of each
_PLAIN = re.compile(r"[-+0-9.eE,]*")  # what numbers with commas between consist of, and nothing else that float() reads
_NUMBER = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?")
_NO_VALUE = re.compile(r"([-+]?(nan|inf)|)", re.IGNORECASE)  # how programs write that there is none
_DAY = r"(?:19[7-9]|20[0-9])[0-9]-(?:0[1-9]|1[0-2])-(?:0[1-9]|[12][0-9]|3[01])"
_TIME = r"(?:[01][0-9]|2[0-3]):[0-5][0-9]:[0-5][0-9](?:\.[0-9]{1,9})?"
_DATE = re.compile(f"{_DAY}[T ]{_TIME}")
_ZONED = re.compile(f"({_DAY}[T ]{_TIME})(?:Z|([-+])([01][0-9]|2[0-3]):?([0-5][0-9]))")
_CLOCK = re.compile(_TIME)
_PER_SECOND = 10**9
NUMBER, DATE, ZONED, CLOCK = "number", "date", "date with a zone", "clock"  # how the entries of a column are written


@dataclass
class Odd:
    """Entries of a column that are no number: how many, the first few, and where the first and the last stand."""

    count: int = 0
    examples: list[str] = field(default_factory=list[str])
    first: int = 0
    last: int = 0

    def add(self, texts: Sequence[str | None], where: np.ndarray, offset: int) -> None:
        """Count the entries of a block at the indices ``where``, whose first row is ``offset``."""
        if not len(where):
            return
        self.first = self.first if self.count else offset + int(where[0])
        self.last = offset + int(where[-1])
        self.count += len(where)
        for index in where[: _EXAMPLES - len(self.examples)].tolist():
            self.examples.append(printable(str(texts[index]), _QUOTED))


def read_cells(texts: Sequence[str | None], odd: Odd, offset: int) -> tuple[Floats, str]:
    """Values of a block of one column, NaN where an entry is no number, and how they are written.

    Args:
        texts: the entries; None where there is none.
        odd: collects the entries that are no number.
        offset: row of the table at which the block begins.
    """
    given = [text for text in texts if text is not None]
    if _PLAIN.fullmatch(",".join(given)):
        try:
            return bounded(_with_gaps(np.array(list(map(float, given))), texts)), NUMBER
        except ValueError:  # some entry is no number: find out which
            pass
    trimmed = ["" if text is None else text.strip() for text in texts]
    none = np.array([_NO_VALUE.fullmatch(text) is not None for text in trimmed], bool)
    for written, pattern, convert in _WRITTEN:
        fits = [pattern.fullmatch(text) is not None for text in trimmed]
        found = np.flatnonzero(fits)
        if not len(found):
            continue
        values = np.full(len(trimmed), np.nan)
        try:
            values[found] = convert([trimmed[i] for i in found.tolist()])
        except ValueError:  # the 30th of February
            continue
        odd.add(trimmed, np.flatnonzero(~(np.array(fits) | none)), offset)
        return bounded(values), written
    odd.add(trimmed, np.flatnonzero(~none), offset)
    return np.full(len(trimmed), np.nan), NUMBER


def _with_gaps(values: Floats, texts: Sequence[str | None]) -> Floats:
    """Values in the places of the entries that there are, NaN in those of the others."""
    if len(values) == len(texts):
        return values
    whole = np.full(len(texts), np.nan)
    whole[[text is not None for text in texts]] = values
    return whole


def bounded(values: Floats) -> Floats:
    """The values (T,), written over, NaN where one is too large to be any quantity."""
    values[~(np.abs(values) < LARGEST)] = np.nan
    return values


def is_no_value(text: str) -> bool:
    """Whether an entry says that there is none."""
    return _NO_VALUE.fullmatch(text.strip()) is not None


def _numbers(texts: list[str]) -> Floats:
    return np.array(list(map(float, texts)))


def _dates(texts: list[str]) -> Floats:
    return np.array(texts, "datetime64[ns]").astype(np.int64) / _PER_SECOND


def _zoned(texts: list[str]) -> Floats:
    parts = [match.groups() for match in map(_ZONED.fullmatch, texts) if match]
    minutes = np.array([int(f"{sign}1") * (60 * int(h) + int(m)) if sign else 0 for _, sign, h, m in parts])
    local = np.array([day for day, *_ in parts], "datetime64[ns]").astype(np.int64)
    return (local - 60 * _PER_SECOND * minutes) / _PER_SECOND


def _clocks(texts: list[str]) -> Floats:
    return _dates([f"1970-01-01T{text}" for text in texts])


_WRITTEN: tuple[tuple[str, re.Pattern[str], Callable[[list[str]], Floats]], ...] = (
    (NUMBER, _NUMBER, _numbers),
    (DATE, _DATE, _dates),
    (ZONED, _ZONED, _zoned),
    (CLOCK, _CLOCK, _clocks),
)
