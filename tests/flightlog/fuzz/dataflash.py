"""ArduPilot's logs, binary and as text: of a short dive and of firmware, with fields of other types and values."""

import math
import struct
from functools import cache
from typing import Any, NamedTuple

from hypothesis import strategies as st

from tests.flightlog.dataflash_writer import dive
from tests.flightlog.fuzz.damage import MOST, Draw, Log, bytes_altered, chance, named, place, reordered
from tests.flightlog.fuzz.values import integers, numbers, raw, texts
from tests.flightlog.shared_data import EXCERPTS

_CODES = {
    "a": "64s", "b": "b", "B": "B", "h": "h", "H": "H", "i": "i", "I": "I", "f": "f", "d": "d", "n": "4s", "N": "16s",
    "Z": "64s", "c": "h", "C": "H", "e": "i", "E": "I", "L": "i", "M": "B", "q": "q", "Q": "Q", "g": "e",
}  # fmt: skip
_FMT = 128
_EVERY = 8  # of the records of the excerpt, one of so many: a draw takes milliseconds


class Kind(NamedTuple):
    """A type of message as its FMT record describes it."""

    number: int
    size: int
    name: bytes
    types: str
    columns: bytes


class Record(NamedTuple):
    """A message: the number of its type and the values of its fields."""

    kind: int
    values: tuple[Any, ...]


def _packed(code: str, value: Any) -> bytes:
    """A value as the type ``code`` has it, whatever it is: integers go round, and what is no number is one of none."""
    form = _CODES.get(code, "B")
    if form.endswith("s"):
        return struct.pack(
            f"<{form}", value if isinstance(value, bytes) else str(value)[:64].encode("utf-8", "replace")
        )
    if isinstance(value, float) and not math.isfinite(value):
        value = value if form in "fde" else 0
    number = value if isinstance(value, int | float) else 0
    if form in "fde":
        try:
            return struct.pack(f"<{form}", float(number))
        except OverflowError:
            return struct.pack(f"<{form}", math.inf)
    whole = int(number)
    return (whole % 256 ** struct.calcsize(form)).to_bytes(struct.calcsize(form), "little")


def _described(kind: Kind) -> bytes:
    return struct.pack(
        "<3B2B4s16s64s",
        0xA3,
        0x95,
        _FMT,
        kind.number % 256,
        kind.size % 256,
        kind.name,
        kind.types.encode(),
        kind.columns,
    )


def _size(types: str) -> int:
    return 3 + struct.calcsize("<" + "".join(_CODES.get(c, "B") for c in types))


def _split(data: bytes, every: int = 1) -> tuple[list[Kind], list[Record]]:
    """The types and messages of a sound log."""
    kinds: dict[int, Kind] = {}
    records, at, count = [], 0, 0
    while at + 3 <= len(data):
        number = data[at + 2]
        if number == _FMT:
            kind, size, name, types, columns = struct.unpack_from("<2B4s16s64s", data, at + 3)
            kinds[kind] = Kind(kind, size, name.rstrip(b"\0"), types.rstrip(b"\0").decode(), columns.rstrip(b"\0"))
            at += 89
            continue
        kind = kinds[number]
        values = struct.unpack_from("<" + "".join(_CODES[c] for c in kind.types), data, at + 3)
        count += 1
        if kind.name in (b"PARM", b"MSG") or count % every == 0:
            records.append(Record(number, values))
        at += kind.size
    return [kind for number, kind in kinds.items() if number != _FMT], records


@cache
def _sound() -> tuple[tuple[list[Kind], list[Record]], ...]:
    return _split(dive(seconds=3.0)), _split((EXCERPTS / "ardusub.BIN").read_bytes(), _EVERY)


def _changed(draw: Draw, kind: Kind) -> Kind:
    """A type with a field of another type or name, more or fewer of them, or other claims."""
    types, columns = list(kind.types), kind.columns.split(b",")
    i = place(draw, len(types))
    match draw(
        st.sampled_from(("type", "type", "rename", "repeat", "less", "more", "name", "size", "number", "types"))
    ):
        case "type":
            types[i] = draw(st.sampled_from(list(_CODES)))
        case "rename":
            columns[i] = draw(raw | st.sampled_from((b"TimeUS", b"t", b"at", b"-", b"Name", b"Value")))
        case "repeat":
            columns[i] = columns[0]
        case "less":
            del types[i], columns[i]
        case "more":
            types.append(draw(st.sampled_from(list(_CODES))))
            columns.append(b"Spare")
        case "name":
            return kind._replace(name=draw(raw | st.sampled_from((b"RCOU", b"PARM", b"XKF1", b"FMT"))))
        case "size":
            return kind._replace(size=draw(st.integers(0, 255)))
        case "number":
            return kind._replace(number=draw(st.integers(0, 255)))
        case "types":
            return kind._replace(types=draw(st.text("\0?\x7fafQZBXx\xe9", max_size=8)))
    return kind._replace(types="".join(types), columns=b",".join(columns), size=_size("".join(types)))


@st.composite
def _parts(draw: Draw) -> tuple[list[Kind], list[Record]]:
    """Types and messages, some of them not as a vehicle writes them."""
    kinds, records = draw(st.sampled_from(range(2)).map(lambda i: _sound()[i]))
    kinds, records = list(kinds), list(records)
    for _ in range(draw(st.integers(0, MOST)) if chance(draw, 2) else 0):
        i = place(draw, len(kinds))
        kinds[i] = _changed(draw, kinds[i])
    for _ in range(draw(st.integers(1, 2 * MOST)) if not chance(draw, 3) else 0):
        i = place(draw, len(records))
        values = list(records[i].values)
        j = place(draw, len(values))
        new = draw(raw | texts if isinstance(values[j], bytes) else numbers)
        if chance(draw, 4):  # in all messages of this type, such as time, parameters or a sensor that is broken
            like = records[i].kind
            records = [
                Record(r.kind, (*r.values[:j], new, *r.values[j + 1 :])) if r.kind == like else r for r in records
            ]
        else:
            values[j] = new
            records[i] = Record(records[i].kind, tuple(values))
    return kinds, reordered(draw, records)


@st.composite
def _binary(draw: Draw) -> bytes:
    kinds, records = draw(_parts())
    by_number = {kind.number: kind for kind in kinds}
    pieces = [_described(kind) for kind in kinds]
    for number, values in records:
        kind = by_number.get(number)
        if kind is not None:
            padded = (*values, *[0] * 16)[: len(kind.types)]
            body = b"".join(_packed(code, value) for code, value in zip(kind.types, padded, strict=True))
            pieces.append(bytes((0xA3, 0x95, number % 256)) + body)
    return bytes_altered(draw, b"".join(reordered(draw, pieces)))


def _spelt(value: Any) -> bytes:
    if isinstance(value, bytes):
        return value.rstrip(b"\0")
    return repr(value).encode() if isinstance(value, float) else str(value)[:4000].encode("utf-8", "surrogatepass")


@st.composite
def _text(draw: Draw) -> bytes:
    kinds, records = draw(_parts())
    by_number = {kind.number: kind for kind in kinds}
    lines = [b"FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"]
    lines += [b"FMT, %d, %d, %s, %s, %s" % (k.number, k.size, k.name, k.types.encode(), k.columns) for k in kinds]
    for number, values in records:
        if number in by_number:
            lines.append(b", ".join([by_number[number].name, *(_spelt(value) for value in values)]))
    for _ in range(draw(st.integers(0, MOST))):
        entries = lines[i := place(draw, len(lines))].split(b", ")
        entries[place(draw, len(entries))] = draw(raw | integers.map(lambda number: str(number)[:4000].encode()))
        lines[i] = b", ".join(entries)
    end = draw(st.sampled_from((b"\n", b"\r\n", b"\r")))
    return bytes_altered(draw, end.join(reordered(draw, lines)) + end)


def logs() -> st.SearchStrategy[Log]:
    """Binary logs."""
    return named((".BIN", ".bin", ""), _binary())


def text_logs() -> st.SearchStrategy[Log]:
    """Logs as text."""
    return named((".log", ".txt"), _text())
