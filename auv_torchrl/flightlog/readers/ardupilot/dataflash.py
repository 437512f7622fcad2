"""ArduPilot's DataFlash log, ``.BIN``: records of 0xA3 0x95, type and fields, described by FMT records in the file.

Read block by block, so that a file may be larger than the memory. Within a block all records are found at once: every
place that looks like the head of a record points to where it ends, and those that point to each other are records. What
lies between is skipped and counted, so that a file that is cut, or that other data was written into, can be read.
"""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from auv_torchrl.flightlog.findings import Finding, FlightLogError, Severity
from auv_torchrl.flightlog.readers.descriptions import Description, Wanted, checked, damaged, described
from auv_torchrl.flightlog.readers.messages import AT, Messages, in_order, left_out, most_of
from auv_torchrl.quantities import counted

MAGIC = b"\xa3\x95"
FMT = 128  # type of the record that describes a type; its own form is fixed
FMT_SIZE = 89  # bytes: head 3, type, length, name 4, format 16, columns 64
_HEAD = 3  # bytes
_LONGEST = 255  # bytes of a record
_BLOCK = 16 << 20  # bytes; index arrays of a block take about as much
CODES = {  # https://ardupilot.org/dev/docs/code-overview-adding-a-new-log-message.html
    "a": ("<i2", 32), "b": ("i1", 1), "B": ("u1", 1), "h": ("<i2", 1), "H": ("<u2", 1), "i": ("<i4", 1),
    "I": ("<u4", 1), "f": ("<f4", 1), "d": ("<f8", 1), "n": ("S4", 1), "N": ("S16", 1), "Z": ("S64", 1),
    "c": ("<i2", 1), "C": ("<u2", 1), "e": ("<i4", 1), "E": ("<u4", 1), "L": ("<i4", 1), "M": ("u1", 1),
    "q": ("<i8", 1), "Q": ("<u8", 1), "g": ("<f2", 1),
}  # fmt: skip
_SCALE = {"c": 1e-2, "C": 1e-2, "e": 1e-2, "E": 1e-2, "L": 1e-7}
_FEW = 5  # heads, as many as bytes that are no records may hold by chance
_MOST_DESCRIPTIONS = 4096  # that differ, of a file; a type has one, and there are 256 types


class Form(NamedTuple):
    """How the records of a type are laid out."""

    name: str
    layout: np.dtype  # of a record, head included
    scales: Mapping[str, float]


def _form_of(name: str, fields: list[str], types: str) -> Form:
    each = list(zip(fields, types, strict=True))
    layout = np.dtype([("-", "V3"), *((f, CODES[c][0], (CODES[c][1],) * (CODES[c][1] > 1)) for f, c in each)])
    return Form(name, layout, {f: _SCALE[c] for f, c in each if c in _SCALE})


_OF_FORMS = _form_of("FMT", ["Type", "Length", "Name", "Format", "Columns"], "BBnNZ")


@dataclass
class _Found:
    """What was read so far."""

    wanted: Wanted
    forms: dict[int, Form] = field(default_factory=lambda: {FMT: _OF_FORMS})
    descriptions: dict[bytes, tuple[Description, Form | None]] = field(default_factory=dict)  # by record
    read: dict[Description, None] = field(default_factory=dict)  # descriptions that are records of the file
    anew: int = 0  # times at which a type was described otherwise than before
    parts: dict[str, list[dict[str, np.ndarray]]] = field(default_factory=dict)
    records: Counter[str] = field(default_factory=Counter)  # of each type in parts
    unknown: Counter[tuple[int, int]] = field(default_factory=Counter)  # heads of types that nothing describes
    more: Counter[str] = field(default_factory=Counter)  # records of each type that are too many
    lost: int = 0  # bytes that belong to no record

    def length(self) -> np.ndarray:
        """Bytes of a record by type, (256,); 0 for those that are not known."""
        lengths = np.zeros(256, np.int64)
        for kind, form in self.forms.items():
            lengths[kind] = form.layout.itemsize
        return lengths


def read_messages(path: Path, wanted: Wanted) -> Messages:
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
    odd = {entry.name: entry for entry in _without_records(found)}
    read = [entry for entry in found.read if entry.name not in odd or entry.damage]
    findings = (*damaged((*read, *odd.values()), wanted), *_lost(found, begin + len(rest)))
    if not found.parts:
        reasons = "".join(f"; {finding.sentence}" for finding in findings)
        raise FlightLogError(
            f"{path.name} begins like an ArduPilot log and holds no record that can be read{reasons}: copy it from the "
            "vehicle again"
        )
    types = {name: _timed(_joined(found.parts.pop(name))) for name in list(found.parts)}
    return in_order(types, findings)


def _lost(found: _Found, size: int) -> Iterator[Finding]:
    if found.lost > FMT_SIZE:  # the last record of a log is usually cut
        sentence = (
            f"{found.lost:,} of {counted(size, 'byte')} belong to no record and are skipped: the file is cut or damaged"
        )
        yield Finding(Severity.WARNING, "damaged_file", sentence, "Copy it from the vehicle again")
    if len(found.descriptions) >= _MOST_DESCRIPTIONS:
        sentence = f"the file describes messages in more than {_MOST_DESCRIPTIONS:,} ways; further ones are left out"
        yield Finding(Severity.WARNING, "too_many_descriptions", sentence, "Copy it from the vehicle again")
    yield from left_out(found.more)


def _joined(parts: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    shared = set.intersection(*(set(part) for part in parts))  # a type may be described anew with other fields
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0] if name in shared}


def _timed(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    if "TimeUS" in columns:
        columns["t"] = columns.pop("TimeUS").astype(np.float64) * 1e-6
    return columns


def _read_block(data: np.ndarray, begin: int, found: _Found) -> int:
    """Take the records of a block; returns how many bytes of it are done with.

    Where a type is described anew and otherwise, what is before is read by the description until then.
    """
    if len(data) <= _HEAD:
        return 0
    heads = np.flatnonzero((data[:-2] == MAGIC[0]) & (data[1:-1] == MAGIC[1]))
    descriptions = heads[(data[heads + 2] == FMT) & (heads + FMT_SIZE <= len(data))].tolist()
    done = known = 0
    while known < len(descriptions):
        known = _learn_forms(data, descriptions, known, found)
        if known < len(descriptions) and descriptions[known] > done:
            stop = descriptions[known]
            inside = heads[slice(*np.searchsorted(heads, (done, stop)))]
            used = _read_records(data[:stop], inside, done, begin, found)
            found.lost += stop - used  # cut by the description, which is a record itself
            done = stop
        if known < len(descriptions):
            _learn(data, descriptions[known], found)
            known += 1
    return _read_records(data, heads[np.searchsorted(heads, done) :], done, begin, found)


def _read_records(data: np.ndarray, heads: np.ndarray, done: int, begin: int, found: _Found) -> int:
    """Take the records at ``heads``, from ``done`` on; returns up to where bytes are done with."""
    length = found.length()[data[heads + 2]]
    _count_unknown(data, heads, length, found)
    heads, length = heads[length > 0], length[length > 0]
    if not len(heads):
        stop = max(done, len(data) - _LONGEST)
        found.lost += stop - done
        return stop
    records, stop = _chain(heads, heads + length, len(data))
    taken = heads[records]
    found.lost += stop - done - int(length[records].sum())
    kinds = data[taken + 2]
    for kind in np.unique(kinds).tolist():
        form, mine = found.forms[kind], taken[kinds == kind]
        if kind == FMT:
            found.read.update(dict.fromkeys(_descriptions_at(data, mine, found)))
        if form.name in found.wanted:
            room = max(most_of(form.name) - found.records[form.name], 0)
            found.records[form.name] += len(mine[:room])
            found.more[form.name] += len(mine[room:])
            part = _extract(data, mine[:room], form, found.wanted[form.name])
            part[AT] = mine[:room] + begin
            found.parts.setdefault(form.name, []).append(part)
    return stop


def _count_unknown(data: np.ndarray, heads: np.ndarray, length: np.ndarray, found: _Found) -> None:
    """Count heads of types that nothing describes, by type and by how far the next head is."""
    known = np.flatnonzero(length[:-1] == 0)
    apart = heads[known + 1] - heads[known]
    near = apart <= _LONGEST
    pairs = data[heads[known[near]] + 2].astype(np.int64) * (_LONGEST + 1) + apart[near]
    for pair, number in zip(*(each.tolist() for each in np.unique(pairs, return_counts=True)), strict=True):
        found.unknown[divmod(pair, _LONGEST + 1)] += number


def _without_records(found: _Found) -> Iterator[Description]:
    """Types that are described and have no record, while as long ones of a type stand there that nothing describes."""
    for kind, form in found.forms.items():
        if form.name not in found.wanted or form.name in found.parts:
            continue
        for (other, size), number in found.unknown.items():
            if size == form.layout.itemsize and number >= _FEW and other not in found.forms:
                damage = (
                    f"it gives it the type {kind}, and {counted(number, 'record')} of its length have the type {other}"
                )
                yield Description(form.name, (), "", damage)


def _descriptions_at(data: np.ndarray, heads: np.ndarray, found: _Found) -> Iterator[Description]:
    for head in heads.tolist():
        known = found.descriptions.get(data[head : head + FMT_SIZE].tobytes())
        if known is not None:
            yield known[0]


def _learn_forms(data: np.ndarray, heads: list[int], first: int, found: _Found) -> int:
    """Learn the descriptions at ``heads`` from the ``first`` on, up to one that says otherwise of a type known."""
    for number in range(first, len(heads)):
        form = _described_at(data, heads[number], found)
        before = found.forms.get(data[heads[number] + 3])
        if form and form.name and before and before.name and form != before and found.anew < _MOST_DESCRIPTIONS:
            found.anew += 1
            return number
        _learn(data, heads[number], found)
    return len(heads)


def _learn(data: np.ndarray, head: int, found: _Found) -> None:
    """Take a description; a damaged one does not take the place of a sound one."""
    form, kind = _described_at(data, head, found), int(data[head + 3])
    if form is not None and (form.name or kind not in found.forms):
        found.forms[kind] = form


def _described_at(data: np.ndarray, head: int, found: _Found) -> Form | None:
    """How the records are laid out that the FMT record at ``head`` describes; None where it does not say.

    The form of a description that is damaged, but says how long its records are, has no name.
    """
    record = data[head : head + FMT_SIZE].tobytes()
    if record not in found.descriptions and len(found.descriptions) < _MOST_DESCRIPTIONS:
        found.descriptions[record] = _parsed(record, found.wanted)
    return found.descriptions.get(record, (None, None))[1]


def _parsed(record: bytes, wanted: Wanted) -> tuple[Description, Form | None]:
    kind, size = record[3], record[4]
    description = described(record[5:9], record[9:25], record[25:], CODES)
    if description.damage:
        return description, None
    form = _form_of(description.name, list(description.fields), description.types)
    if form.layout.itemsize != size:
        says = f"it says that a record has {counted(size, 'byte')}, its columns have {form.layout.itemsize}"
        return description._replace(damage=says), None
    description = checked(description, wanted)
    if description.damage:  # its records can be skipped all the same
        return description, Form("", form.layout, {})
    return description, None if kind == FMT else form


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
