"""The entries of one column of a table as float64: numbers, dates and clocks, and what is none of them.

Numbers are written in ASCII digits. A date (ISO 8601, with or without a zone) becomes seconds since 1970, a clock
seconds since midnight.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute

from auv_torchrl.flightlog.log import Floats
from auv_torchrl.text import printable

pc: Any = pyarrow.compute  # its functions are made when it is imported, and have no types
LARGEST = 1e19  # beyond nanoseconds since 1970 and any unit of length; its square still is a number
_EXAMPLES = 3  # entries that a message quotes
_QUOTED = 20  # characters of each
_NUMBER = r"^[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?$"
_NO_VALUE = r"^(?i)([-+]?(nan|inf)|)$"  # how programs write that there is none
_DAY = r"(19[7-9]|20[0-9])[0-9]-(0[1-9]|1[0-2])-(0[1-9]|[12][0-9]|3[01])"
_CLOCK = r"([01][0-9]|2[0-3]):[0-5][0-9]:[0-5][0-9](\.[0-9]{1,9})?"
_ZONE = r"(Z|[-+]([01][0-9]|2[0-3]):?[0-5][0-9])"
_PER_SECOND = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}
NUMBER, DATE, ZONED, CLOCK = "number", "date", "date with a zone", "clock"  # how the entries of a column are written


@dataclass
class Odd:
    """Entries of a column that are no number: how many, the first few, and where the first and the last stand."""

    count: int = 0
    examples: list[str] = field(default_factory=list[str])
    first: int = 0
    last: int = 0

    def add(self, texts: pa.Array, where: np.ndarray, offset: int) -> None:
        """Count the entries of a block at the indices ``where``, whose first row is ``offset``."""
        if not len(where):
            return
        self.first = self.first if self.count else offset + int(where[0])
        self.last = offset + int(where[-1])
        self.count += len(where)
        for index in where[: _EXAMPLES - len(self.examples)].tolist():
            self.examples.append(printable(str(texts[index].as_py()), _QUOTED))


def is_flat(kind: pa.DataType) -> bool:
    """Whether a column of this type has one value a row that may be a number."""
    if pa.types.is_dictionary(kind):
        return is_flat(kind.value_type)
    return (
        pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind) or _is_text(kind)
        or pa.types.is_boolean(kind) or pa.types.is_null(kind) or pa.types.is_timestamp(kind)
        or pa.types.is_duration(kind)
    )  # fmt: skip


def _is_text(kind: pa.DataType) -> bool:
    return pa.types.is_string(kind) or pa.types.is_large_string(kind)


def read_cells(array: pa.Array, odd: Odd, offset: int) -> tuple[Floats, str]:
    """Values of a block of one column, NaN where an entry is no number, and how they are written.

    Args:
        array: the block.
        odd: collects the entries that are no number.
        offset: row of the table at which the block begins.
    """
    kind = array.type
    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
        per_second = _PER_SECOND[kind.unit]
        return _float64(array.cast(pa.int64())) / per_second, DATE if pa.types.is_timestamp(kind) else NUMBER
    if pa.types.is_dictionary(kind):
        return _of_dictionary(array, odd, offset)
    if not _is_text(kind):
        return _bounded(_float64(array.cast(pa.float64(), safe=False))), NUMBER
    try:
        return _bounded(_float64(array.cast(pa.float64()))), NUMBER  # arrow reads ASCII digits alone
    except pa.ArrowInvalid:  # some entry is no number: find out which
        values, written = _of_text(array, odd, offset)
        return _bounded(values), written


def _of_dictionary(array: pa.DictionaryArray, odd: Odd, offset: int) -> tuple[Floats, str]:
    """Each distinct entry is read once, so that a long text that is repeated costs nothing."""
    distinct = Odd()
    by_code, written = read_cells(array.dictionary, distinct, 0)
    codes = array.indices.fill_null(-1).to_numpy(zero_copy_only=False)
    values = np.concatenate([by_code, [np.nan]])[codes]
    if distinct.count:
        known = np.isfinite(by_code) | _matches(array.dictionary, _NO_VALUE)
        odd.add(array, np.flatnonzero(~np.append(known, True)[codes]), offset)
    return values, written


def _of_text(array: pa.Array, odd: Odd, offset: int) -> tuple[Floats, str]:
    text = pc.utf8_trim_whitespace(array)
    for written, pattern, convert in _WRITTEN:
        fits = pc.match_substring_regex(text, pattern)
        if not pc.any(fits).as_py():
            continue
        try:
            values = convert(pc.if_else(fits, text, None))
        except pa.ArrowInvalid:  # the 30th of February
            continue
        odd.add(text, np.flatnonzero(~(_truth(fits) | _matches(text, _NO_VALUE))), offset)
        return values, written
    odd.add(text, np.flatnonzero(~_matches(text, _NO_VALUE)), offset)
    return np.full(len(array), np.nan), NUMBER


def _matches(text: pa.Array, *patterns: str) -> np.ndarray:
    """(T,) whether an entry fits one of the patterns; an entry that is missing does."""
    trimmed = pc.utf8_trim_whitespace(text)
    return np.logical_or.reduce([_truth(pc.match_substring_regex(trimmed, pattern)) for pattern in patterns])


def _truth(mask: pa.BooleanArray) -> np.ndarray:
    return mask.fill_null(True).to_numpy(zero_copy_only=False)


def _numbers(text: pa.Array) -> Floats:
    return _float64(text.cast(pa.float64()))


def _dates(zone: str | None) -> Callable[[pa.Array], Floats]:
    return lambda text: _float64(text.cast(pa.timestamp("ns", zone)).cast(pa.int64())) / _PER_SECOND["ns"]


def _clock(text: pa.Array) -> Floats:
    return _dates(None)(pc.binary_join_element_wise("1970-01-01T", text, ""))


_WRITTEN = (
    (NUMBER, _NUMBER, _numbers),
    (DATE, f"^{_DAY}[T ]{_CLOCK}$", _dates(None)),
    (ZONED, f"^{_DAY}[T ]{_CLOCK}{_ZONE}$", _dates("UTC")),
    (CLOCK, f"^{_CLOCK}$", _clock),
)


def _float64(array: pa.Array) -> Floats:
    """Values (T,); NaN where there is none. Arrow's own way to numpy loads pandas where there are gaps."""
    if array.null_count:
        array = array.cast(pa.float64(), safe=False).fill_null(np.nan)
    return np.array(np.from_dlpack(array), dtype=np.float64) if len(array) else np.empty(0)


def _bounded(values: Floats) -> Floats:
    values[~(np.abs(values) < LARGEST)] = np.nan
    return values
