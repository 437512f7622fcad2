"""Messages of a log by type, as columns, and a clock that was reset put in order."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from auv_torchrl.flightlog.findings import Finding, Severity
from auv_torchrl.flightlog.readers.descriptions import EVENTS, MOST_EVENTS, MOST_SAMPLES
from auv_torchrl.flightlog.signals import rolling_median
from auv_torchrl.quantities import counted

Columns = Mapping[str, np.ndarray]  # by field; all of one length
AT = "at"  # column, until they are in order: where in the file a message was, as a byte, a line or a number
_JUMP_S = 1.0  # messages are written up to some tenths of a second late; what steps back further is another clock
_TAIL_S = 600.0  # s, for which single messages may follow the last one of the most frequent type
_NEIGHBOURS = 5  # whose median a time must agree with
_MOST = 1e12  # of what a sensor or a filter says, in any unit; a larger number is none that was measured
_INTEGERS = 2**53  # up to which float64 counts


@dataclass(frozen=True)
class Messages:
    """What was read, times in seconds under ``t``."""

    types: Mapping[str, Columns]
    findings: tuple[Finding, ...] = ()
    starts: tuple[float, ...] = ()  # s, when the clock started over

    @property
    def end(self) -> float:
        """The last time that is told, s."""
        return max((float(c["t"].max()) for c in self.types.values() if len(c.get("t", ()))), default=0.0)

    def get(self, name: str, *fields: str) -> Columns | None:
        """The messages of a type; None if there are none or they lack one of the fields."""
        found = self.types.get(name, {})
        return found if all(field in found for field in ("t", *fields)) and len(found["t"]) else None


def stacked(columns: Columns, fields: Iterable[str]) -> np.ndarray:
    """Some fields side by side, (T, k) float64."""
    return np.stack([columns[field].astype(np.float64) for field in fields], axis=-1)


def whole_numbers(values: np.ndarray) -> np.ndarray:
    """Numbers that count or name something, as int64; -1 for what is no number, fractions cut."""
    if values.dtype.kind in "iu" and values.dtype.itemsize < 8:
        return values.astype(np.int64)
    known = np.where(np.isfinite(values.astype(np.float64)), values, -1)
    return known.clip(-_INTEGERS, _INTEGERS).astype(np.int64)


def most_of(name: str) -> int:
    """How many messages of a type are read: a file may be full of one that a vehicle writes now and then."""
    return MOST_EVENTS if name in EVENTS else MOST_SAMPLES


def left_out(more: Mapping[str, int]) -> Iterator[Finding]:
    """A finding for each type of which there are too many messages; ``more`` are how many too many."""
    for name, number in more.items():
        if number:
            sentence = f"{name}: {counted(number, 'message')} beyond the first {most_of(name):,} left out"
            yield Finding(Severity.WARNING, "too_many_messages", sentence, "Give a part of the log")


def changes(*columns: np.ndarray) -> np.ndarray:
    """The first row, and those in which one of the columns (T,) differs from the row before."""
    differs = np.logical_or.reduce([np.diff(column) != 0 for column in columns])
    return np.concatenate(([0], np.flatnonzero(differs) + 1))


def in_order(types: dict[str, dict[str, np.ndarray]], findings: Iterable[Finding] = ()) -> Messages:
    """Times ``t`` that start at 0 and never go back; each start over is put a second behind what was before.

    The messages of the most frequent type are the clock. One whose time is not between those of its neighbours in the
    file is left out. ``types`` is empty afterwards; ``findings`` are what there was to say before.
    """
    findings = [*findings]
    lost = sum(_drop_odd_times(columns) for columns in types.values() if "t" in columns)
    findings += [odd for name, columns in types.items() if (odd := _drop_odd_values(name, columns)) is not None]
    timed = [name for name, columns in types.items() if len(columns.get("t", ()))]
    if not timed:
        return Messages(dict(types), (*findings, *_findings(0, lost)))
    clock = types[max(timed, key=lambda name: len(types[name]["t"]))]
    at, usual = clock[AT], rolling_median(clock["t"], _NEIGHBOURS, "reflect")
    back = np.flatnonzero(np.diff(usual) < -_JUMP_S) + 1
    shifts = np.concatenate(([0.0], np.cumsum(usual[back - 1] - usual[back] + _JUMP_S)))
    begins = at[back - 1] + 1
    usual = usual + shifts[np.searchsorted(back, np.arange(len(usual)), side="right")]
    kept: dict[str, Columns] = {}
    first = np.inf
    for name in list(types):
        columns = types.pop(name)  # so that what is put in order is not held twice
        if name not in timed:
            kept[name] = columns
            continue
        t = columns["t"] + shifts[np.searchsorted(begins, columns[AT], side="right")]
        after = np.searchsorted(at, columns[AT])
        low = np.where(after > 0, usual[np.maximum(after - 1, 0)], -np.inf)
        high = usual[np.minimum(after, len(usual) - 1)] + np.where(after < len(usual), 0.0, _TAIL_S)
        good = ((t >= low - _JUMP_S) & (t <= high + _JUMP_S)) | (np.isin(after, back) & np.isfinite(t))
        if not good.all():
            lost += int((~good).sum())
            columns, t = {field: values[good] for field, values in columns.items()}, t[good]
        kept[name] = {field: values for field, values in columns.items() if field != AT} | {"t": t}
        first = min(first, float(t.min())) if len(t) else first
    for name in timed:
        kept[name]["t"][:] -= first if np.isfinite(first) else 0.0
    starts = tuple(float(usual[i]) - first for i in back)
    return Messages(kept, (*findings, *_findings(len(back), lost)), starts)


def _drop_odd_times(columns: dict[str, np.ndarray]) -> int:
    """Leave out messages whose time is none; returns how many."""
    good = (columns["t"] >= 0) & (columns["t"] < _MOST)
    if good.all():
        return 0
    columns.update({field: values[good] for field, values in columns.items()})
    return int((~good).sum())


def _drop_odd_values(name: str, columns: dict[str, np.ndarray]) -> Finding | None:
    """Make NaN what is no number that anything measures; parameters have findings of their own."""
    odd: dict[str, int] = {}
    for field, values in columns.items():
        if field == "t" or values.dtype.kind != "f" or _is_text(columns):
            continue
        large = np.abs(values) > np.float64(_MOST)  # a plain number would be made a half float like those of a field
        if large.any():
            columns[field] = np.where(large, np.nan, values)
            odd[field] = int(large.sum())
    if not odd:
        return None
    listed = ", ".join(f"{number:,} of {field}" for field, number in odd.items())
    sentence = f"{name} has values that are infinite or beyond {_MOST:g}; they are left out: {listed}"
    return Finding(Severity.WARNING, "odd_values", sentence, "Look at what measures them")


def _is_text(columns: Columns) -> bool:
    return any(values.dtype.kind in "SU" for values in columns.values())


def _findings(restarts: int, lost: int) -> Iterator[Finding]:
    if restarts:
        times = counted(restarts, "time")
        sentence = f"the clock of the log starts over {times}; each start is read as a second after the rest"
        yield Finding(Severity.WARNING, "clock_reset", sentence, "Give logs of one start each")
    if lost:
        sentence = f"{counted(lost, 'message bears', 'messages bear')} a time that no message beside has: left out"
        yield Finding(Severity.WARNING, "odd_times", sentence)
