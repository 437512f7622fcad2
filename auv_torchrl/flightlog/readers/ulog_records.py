"""What is in a PX4 log: texts, parameters and topics as columns, message by message from the front.

https://docs.px4.io/main/en/dev_log/ulog_file_format.html describes it. A message has up to 65,535 bytes, so that no
description of a topic can claim more; behind damage the reading goes on where messages follow one another again.
"""

import re
import struct
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from auv_torchrl.flightlog.readers.bounds import MIB, MOST_VALUES, Loss
from auv_torchrl.quantities import counted

MAGIC = b"ULog"
_HEAD_BYTES = 16
_KINDS = frozenset(b"BFIMPQARSDOLC")  # of messages
_HEADS = re.compile(rb"(?=[^\0].[BFIMPQARSDOLC]|\0[^\0][BFIMPQARSDOLC])", re.DOTALL)  # length and kind of a message
_IN_A_ROW = 3
_NUMBERS = {
    "int8_t": "i1", "uint8_t": "u1", "int16_t": "<i2", "uint16_t": "<u2", "int32_t": "<i4", "uint32_t": "<u4",
    "int64_t": "<i8", "uint64_t": "<u8", "float": "<f4", "double": "<f8", "bool": "i1", "char": "i1",
}  # fmt: skip
_FIELD = re.compile(r"(\w{1,100})(?:\[([0-9]{1,5})\])? (\w{1,100})", re.ASCII)
_MOST_BYTES = 65535  # of a message, whose length has 16 bits
_MOST_FORMATS = 5000  # topics that are described; PX4 has some 250
_MOST_PARAMETERS = 10_000  # and infos; PX4 has 1,500
_DEEPEST = 8  # types within one another
_MOST_FIELDS = 1000  # of a topic with all that is in it
_BLOCK = 4 * MIB

Topic = dict[str, np.ndarray]  # columns, one entry a sample


@dataclass
class Content:
    """Everything of a log that is needed."""

    start_us: int = 0
    infos: dict[str, str | float] = field(default_factory=dict)
    parameters: dict[str, float] = field(default_factory=dict)
    topics: dict[str, Topic] = field(default_factory=dict)


def read_content(path: Path, wanted: Iterable[str], loss: Loss) -> Content:
    """What a PX4 log holds of the topics ``wanted``, the first instance of each; ``loss`` takes what is left out."""
    found, reading = Content(), _Reading(frozenset(wanted), loss)
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
        if len(head) == _HEAD_BYTES:
            found.start_us = struct.unpack_from("<Q", head, 8)[0]
        data, at, more = b"", 0, True
        while not loss.stopped:
            if more and len(data) - at < _MOST_BYTES + 3:
                block = file.read(_BLOCK)
                data, at, more = data[at:] + block, 0, bool(block)
            if len(data) - at < 3:
                break
            size, kind = struct.unpack_from("<HB", data, at)
            if kind not in _KINDS or not size:
                good = _next_good(data, at + 1)
                loss.add("damaged bytes", good - at)
                at = good
                continue
            if at + 3 + size > len(data):
                loss.cut("what was to come behind the end of the file")
                break
            reading.take(kind, data[at + 3 : at + 3 + size], found)
            at += 3 + size
    found.topics = reading.topics()
    return found


def _next_good(data: bytes, at: int) -> int:
    """Where messages go on behind damage: three of a kind that there is, one behind the other; else the end."""
    for place in (found.start() for found in _HEADS.finditer(data, at)):
        next_one = place
        for _ in range(_IN_A_ROW):
            if next_one + 3 > len(data) or data[next_one + 2] not in _KINDS:
                break
            next_one += 3 + struct.unpack_from("<H", data, next_one)[0]
        else:
            return place
    return len(data)


class _Reading:
    """Formats, subscriptions and samples while they are read."""

    def __init__(self, wanted: frozenset[str], loss: Loss) -> None:
        self._wanted, self._loss = wanted, loss
        self._formats: dict[str, str] = {}
        self._types: dict[int, tuple[str, np.dtype]] = {}  # by number of the subscription
        self._samples: dict[str, bytearray] = {}
        self._dtypes: dict[str, np.dtype] = {}
        self._left = MOST_VALUES * 8  # bytes

    def take(self, kind: int, data: bytes, found: Content) -> None:
        """Take one message."""
        try:
            if kind == ord("D"):
                self._sample(data)
            elif kind == ord("F"):
                self._format(data)
            elif kind == ord("A"):
                self._subscribe(data)
            elif kind == ord("I") and len(found.infos) < _MOST_PARAMETERS:
                name, value = _keyed(data)
                found.infos[name] = value
            elif kind == ord("P") and len(found.parameters) < _MOST_PARAMETERS:
                name, value = _keyed(data)
                if not isinstance(value, str):
                    found.parameters.setdefault(name, value)  # the first is how the vehicle was set when it armed
        except (struct.error, ValueError, IndexError, KeyError):
            self._loss.add("messages that are damaged")

    def topics(self) -> dict[str, Topic]:
        """The columns of each topic."""
        made = {}
        for name, data in self._samples.items():
            rows = np.frombuffer(data, self._dtypes[name])
            made[name] = dict(_columns(rows, ""))
        return made

    def _format(self, data: bytes) -> None:
        name, _, fields = data.decode("ascii", "replace").partition(":")
        if len(self._formats) < _MOST_FORMATS:
            self._formats.setdefault(name, fields)

    def _subscribe(self, data: bytes) -> None:
        number, name = struct.unpack_from("<H", data, 1)[0], data[3:].decode("ascii", "replace")
        if name not in self._wanted or name in self._dtypes:
            return  # not needed, or another instance of one that is
        dtype = self._dtype(name, _DEEPEST, [_MOST_FIELDS])
        if dtype.itemsize > _MOST_BYTES:
            raise ValueError(f"{name} has {counted(dtype.itemsize, 'byte')}")
        self._types[number] = name, dtype
        self._dtypes[name] = dtype
        self._samples[name] = bytearray()

    def _dtype(self, name: str, deepest: int, left: list[int]) -> np.dtype:
        """How a sample lies in memory.

        Raises:
            KeyError: for a type that is not described.
            ValueError: for a description that says nothing, that holds itself, or is larger than a message.
        """
        if not deepest:
            raise ValueError(f"{name} holds too many types in one another")
        fields = []
        for text in self._formats[name].split(";"):
            if not text:
                continue
            found = _FIELD.fullmatch(text)
            left[0] -= 1
            if found is None or left[0] < 0:
                raise ValueError(f"{name} has a field {text[:40]!r}")
            kind, count, label = found.groups()
            base = np.dtype(_NUMBERS[kind]) if kind in _NUMBERS else self._dtype(kind, deepest - 1, left)
            number = int(count) if count else 1
            if base.itemsize * number > _MOST_BYTES:
                raise ValueError(f"{name} has a field of {counted(base.itemsize * number, 'byte')}")
            fields.append((label, base, (number,)) if count else (label, base))
        if not fields:
            raise ValueError(f"{name} has no fields")
        return np.dtype(fields)

    def _sample(self, data: bytes) -> None:
        known = self._types.get(struct.unpack_from("<H", data)[0])
        if known is None:
            return
        name, dtype = known
        # padding at the end of a topic is described and not written
        content = data[2 : 2 + dtype.itemsize].ljust(dtype.itemsize, b"\0")
        if len(data) - 2 < dtype.itemsize - 8:
            raise ValueError(f"{name} has {counted(len(data) - 2, 'byte')}")
        self._left -= len(content)
        if self._left < 0:
            self._loss.stop(f"it holds more than {MOST_VALUES:,} numbers")
            return
        self._samples[name] += content


def _columns(rows: np.ndarray, prefix: str) -> Iterable[tuple[str, np.ndarray]]:
    """Columns of numbers, entries of arrays as ``name[i]``; what is in another type is not needed."""
    for name in rows.dtype.names or ():
        dtype = rows.dtype[name]
        if dtype.subdtype is None and dtype.fields is None:
            yield f"{prefix}{name}", rows[name]
        elif dtype.subdtype is not None and dtype.subdtype[0].fields is None:
            for i in range(dtype.shape[0]):
                yield f"{prefix}{name}[{i}]", rows[name][:, i]


def _keyed(data: bytes) -> tuple[str, str | float]:
    """Name and value of an info or a parameter.

    Raises:
        ValueError: for a value of another type.
    """
    length = data[0]
    kind, _, name = data[1 : 1 + length].decode("ascii", "replace").partition(" ")
    value = data[1 + length :]
    if kind.startswith("char"):
        return name, value.decode("utf-8", "replace")
    dtype = np.dtype(_NUMBERS.get(kind, "V0"))
    if not dtype.itemsize or len(value) != dtype.itemsize:
        return name, ""
    return name, np.frombuffer(value, dtype)[0].item()
