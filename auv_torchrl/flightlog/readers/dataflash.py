"""ArduPilot's DataFlash log, ``.BIN``: records of 0xA3 0x95, type and fields, described by FMT records in the file.

Read block by block, so that a file may be larger than the memory. Within a block all records are found at once: every
place that looks like the head of a record points to where it ends, and those that point to each other are records. What
lies between is skipped and counted, so that a file that is cut, or that other data was written into, can be read.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from auv_torchrl.flightlog.findings import Finding, FlightLogError, Severity
from auv_torchrl.flightlog.readers.messages import AT, Messages, in_order

MAGIC = b"\xa3\x95"
FMT = 128  # type of the record that describes a type; its own form is fixed
FMT_SIZE = 89  # bytes: head 3, type, length, name 4, format 16, columns 64
_HEAD = 3  # bytes
_LONGEST = 255  # bytes of a record
_BLOCK = 16 << 20  # bytes; index arrays of a block take about as much
_TYPES = {  # https://ardupilot.org/dev/docs/code-overview-adding-a-new-log-message.html
    "a": ("<i2", 32), "b": ("i1", 1), "B": ("u1", 1), "h": ("<i2", 1), "H": ("<u2", 1), "i": ("<i4", 1),
    "I": ("<u4", 1), "f": ("<f4", 1), "d": ("<f8", 1), "n": ("S4", 1), "N": ("S16", 1), "Z": ("S64", 1),
    "c": ("<i2", 1), "C": ("<u2", 1), "e": ("<i4", 1), "E": ("<u4", 1), "L": ("<i4", 1), "M": ("u1", 1),
    "q": ("<i8", 1), "Q": ("<u8", 1), "g": ("<f2", 1),
}  # fmt: skip
_SCALE = {"c": 1e-2, "C": 1e-2, "e": 1e-2, "E": 1e-2, "L": 1e-7}
_NAME = re.compile(rb"[A-Za-z][A-Za-z0-9_]{0,3}\0*")
_COLUMNS = re.compile(rb"[A-Za-z0-9_,]+\0*")


class Form(NamedTuple):
    """How the records of a type are laid out."""

    name: str
    layout: np.dtype  # of a record, head included
    scales: Mapping[str, float]


def _form_of(name: str, fields: list[str], types: str) -> Form:
    each = list(zip(fields, types, strict=True))
    layout = np.dtype([("-", "V3"), *((f, _TYPES[c][0], (_TYPES[c][1],) * (_TYPES[c][1] > 1)) for f, c in each)])
    return Form(name, layout, {f: _SCALE[c] for f, c in each if c in _SCALE})


_OF_FORMS = _form_of("FMT", ["Type", "Length", "Name", "Format", "Columns"], "BBnNZ")


@dataclass
class _Found:
    """What was read so far."""

    wanted: Mapping[str, tuple[str, ...]]
    forms: dict[int, Form] = field(default_factory=lambda: {FMT: _OF_FORMS})
    parts: dict[str, list[dict[str, np.ndarray]]] = field(default_factory=dict)
    lost: int = 0  # bytes that belong to no record

    def length(self) -> np.ndarray:
        """Bytes of a record by type, (256,); 0 for those that are not known."""
        lengths = np.zeros(256, np.int64)
        for kind, form in self.forms.items():
            lengths[kind] = form.layout.itemsize
        return lengths


def read_messages(path: Path, wanted: Mapping[str, tuple[str, ...]]) -> Messages:
    """The records of the types ``wanted``, with those of their fields that the log has; times ``t`` in s.

    Raises:
        FlightLogError: if there is no record in the file.
    """
    found = _Found(wanted)
    with path.open("rb") as file:
        begin, rest = 0, b""
        while block := file.read(_BLOCK):
            data = rest + block
            used = _read_block(np.frombuffer(data, np.uint8), begin, found)
            begin, rest = begin + used, data[used:]
    found.lost += len(rest)
    if not found.parts:
        raise FlightLogError(
            f"{path.name} begins like an ArduPilot log and holds no record that can be read: copy it from the vehicle "
            "again"
        )
    types = {name: _timed(_joined(found.parts.pop(name))) for name in list(found.parts)}
    return in_order(types, _lost(found.lost, begin + len(rest)))


def _lost(lost: int, size: int) -> Iterable[Finding]:
    if lost > FMT_SIZE:  # the last record of a log is usually cut
        sentence = f"{lost:,} of {size:,} bytes belong to no record and are skipped: the file is cut or damaged"
        yield Finding(Severity.WARNING, "damaged_file", sentence, "Copy it from the vehicle again")


def _joined(parts: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    shared = set.intersection(*(set(part) for part in parts))  # a type may be described anew with other fields
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0] if name in shared}


def _timed(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    if "TimeUS" in columns:
        columns["t"] = columns.pop("TimeUS").astype(np.float64) * 1e-6
    return columns


def _read_block(data: np.ndarray, begin: int, found: _Found) -> int:
    """Take the records of a block; returns how many bytes of it are done with."""
    heads = (
        np.flatnonzero((data[:-2] == MAGIC[0]) & (data[1:-1] == MAGIC[1])) if len(data) > _HEAD else np.zeros(0, int)
    )
    _learn_forms(data, heads, found)
    length = found.length()[data[heads + 2]]
    heads, length = heads[length > 0], length[length > 0]
    if not len(heads):
        keep = min(len(data), _LONGEST)
        found.lost += len(data) - keep
        return len(data) - keep
    records, done = _chain(heads, heads + length, len(data))
    taken = heads[records]
    found.lost += done - int(length[records].sum())
    kinds = data[taken + 2]
    for kind in np.unique(kinds).tolist():
        form = found.forms[kind]
        if form.name in found.wanted:
            part = _extract(data, taken[kinds == kind], form, found.wanted[form.name])
            part[AT] = taken[kinds == kind] + begin
            found.parts.setdefault(form.name, []).append(part)
    return done


def _learn_forms(data: np.ndarray, heads: np.ndarray, found: _Found) -> None:
    fits = heads[(data[heads + 2] == FMT) & (heads + FMT_SIZE <= len(data))]
    for head in fits.tolist():
        record = data[head : head + FMT_SIZE].tobytes()
        kind, size, name, spelt, columns = record[3], record[4], record[5:9], record[9:25], record[25:]
        types = spelt.rstrip(b"\0").decode("ascii", "replace")
        if not (_NAME.fullmatch(name) and _COLUMNS.fullmatch(columns) and all(c in _TYPES for c in types)):
            continue
        fields = columns.rstrip(b"\0").decode().split(",")
        if len(fields) != len(types) or len(set(fields)) != len(fields) or "" in fields:
            continue
        form = _form_of(name.rstrip(b"\0").decode(), fields, types)
        if form.layout.itemsize == size and kind != FMT:
            found.forms[kind] = form


def _chain(heads: np.ndarray, ends: np.ndarray, size: int) -> tuple[np.ndarray, int]:
    """Which of the heads (N,) begin a record, and the byte at which the first one begins that the block cuts."""
    following = np.searchsorted(heads, ends)
    whole = ends <= size
    linked = (ends == size) | ((following < len(heads)) & (heads[np.minimum(following, len(heads) - 1)] == ends))
    plain = linked & (following == np.arange(1, len(heads) + 1))  # nothing that looks like a head within the record
    breaks = np.flatnonzero(~plain)
    sound = np.flatnonzero(linked)
    records = np.zeros(len(heads), bool)
    i = 0
    while i < len(heads):
        where = np.searchsorted(breaks, i)
        stop = int(breaks[where]) if where < len(breaks) else len(heads)
        records[i:stop] = True
        if stop == len(heads):
            return records, int(ends[-1])
        after = int(np.searchsorted(sound, stop + 1))
        if not whole[stop]:  # the block cuts it, unless it is none and records follow within what it claims
            if after == len(sound):
                return records, int(heads[stop])
            i = int(sound[after])
            continue
        records[stop] = True
        i = int(following[stop])
        if not linked[stop]:  # other data follows, or lies in it: go on where a record ends at the head of another one
            i = int(sound[after]) if after < len(sound) else int(following[stop])
            records[stop] = i >= len(heads) or heads[i] >= ends[stop]
    last = np.flatnonzero(records)[-1] if records.any() else 0
    return records, int(ends[last]) if records.any() else int(heads[0])


def _extract(data: np.ndarray, starts: np.ndarray, form: Form, fields: tuple[str, ...]) -> dict[str, np.ndarray]:
    size = form.layout.itemsize
    anywhere = np.ndarray((len(data) - size + 1,), form.layout, data, strides=(1,))  # a record at every byte
    records = anywhere[starts]
    columns = {}
    for name in fields:
        if name in (form.layout.names or ()):
            column = np.ascontiguousarray(records[name])
            columns[name] = column * form.scales[name] if name in form.scales else column
    return columns
