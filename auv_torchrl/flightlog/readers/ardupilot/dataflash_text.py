"""ArduPilot's DataFlash log as text, ``.log``: the same messages, one a line, described by FMT lines.

Where a program of a country with decimal commas wrote the file, fields are told apart by the space behind their comma.
"""

from array import array
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from auv_torchrl.flightlog.findings import Finding, FlightLogError, Severity
from auv_torchrl.flightlog.readers.ardupilot.dataflash import CODES
from auv_torchrl.flightlog.readers.descriptions import (
    TEXT_CODES,
    TEXTS,
    TIME,
    Description,
    Wanted,
    checked,
    damaged,
    described,
)
from auv_torchrl.flightlog.readers.messages import AT, Messages, in_order, left_out, most_of
from auv_torchrl.quantities import counted
from auv_torchrl.text import number

_LONGEST_LINE = 4096  # bytes; a message has 255 at most
_MOST_DESCRIPTIONS = 1000  # of a file; there are 256 types


class _Type:
    """The lines of a type whose description is sound, with those of its fields that are wanted."""

    def __init__(self, description: Description, wanted: tuple[str, ...]) -> None:
        self.description = description
        self.is_text = [code in TEXT_CODES for code in description.types]
        self.keeps = [field in wanted for field in description.fields]
        self.lines = array("q")  # numbers of the lines in the file
        self.numbers = array("d")  # line by line
        self.texts: list[list[str]] = []  # line by line

    def take(self, line: int, rest: str) -> str:
        """Take what stands in a line behind its name; returns how its numbers are written, "" if it cannot be read."""
        for mark, between in ((".", ","), (",", ", ")):
            parts = rest.split(between, len(self.is_text) - 1)
            if len(parts) == len(self.is_text) and self._keep(parts, mark):
                self.lines.append(line)
                return mark
        return ""

    def _keep(self, parts: list[str], mark: str) -> bool:
        numbers, texts = [], []
        for part, is_text, keeps in zip(parts, self.is_text, self.keeps, strict=True):
            if is_text:
                texts += [part.strip()] if keeps else []
                continue
            value = number(part if mark == "." else part.replace(mark, "."))
            if value is None:
                return False
            numbers += [value] if keeps else []
        self.numbers.extend(numbers)
        if texts:
            self.texts.append(texts)
        return True

    def columns(self) -> dict[str, np.ndarray]:
        """What was taken, by field, and the lines."""
        kept = [
            (f, text) for f, text, keeps in zip(self.description.fields, self.is_text, self.keeps, strict=True) if keeps
        ]
        table = np.frombuffer(self.numbers, np.float64).reshape(len(self.lines), -1)
        named = [f for f, text in kept if not text]
        found = {f: table[:, i].copy() for i, f in enumerate(named)}
        found |= {
            f: np.array([texts[i] for texts in self.texts], str) for i, f in enumerate(f for f, text in kept if text)
        }
        return found | {AT: np.frombuffer(self.lines, np.int64).copy()}


@dataclass
class _Found:
    """What was read so far."""

    wanted: Wanted
    types: dict[str, list[_Type]] = field(default_factory=dict)  # by name, as they were described one after the other
    taken: Counter[str] = field(default_factory=Counter)  # lines of each type
    read: dict[Description, None] = field(default_factory=dict)  # all descriptions
    more: Counter[str] = field(default_factory=Counter)  # lines of each type that are too many
    lines: int = 0
    lost: int = 0  # lines that do not hold what their type has
    long: int = 0  # lines that are longer than a message can be
    crowded: int = 0  # of those, lines with more fields than their type has
    commas: int = 0  # lines with decimal commas


def recognizes(head: bytes) -> bool:
    """Whether a file begins as such a log does."""
    return head.lstrip().startswith(b"FMT,") and b"Type,Length,Name,Format" in head


def read_messages(path: Path, wanted: Wanted) -> Messages:
    """The lines of the types ``wanted``, with those of their fields that the log has; times ``t`` in s.

    Raises:
        FlightLogError: if there is no line of these types.
    """
    found = _Found(wanted)
    with path.open("rb") as file:
        for line in _lines(file, found):
            name, _, rest = line.partition(",")
            name = name.strip()
            if name == "FMT":
                _describe(rest, found)
            elif name in found.types:
                _take(name, rest, found)
    findings = (*damaged(found.read, wanted), *_findings(found))
    types = {name: columns for name, kinds in found.types.items() if (columns := _columns(kinds))}
    if not types:
        reasons = "".join(f"; {finding.sentence}" for finding in findings)
        raise FlightLogError(f"{path.name} begins like an ArduPilot log and holds no line that can be read{reasons}")
    return in_order(types, findings)


def _lines(file, found: _Found) -> Iterator[str]:
    """The lines of a file, but for those that are too long; counts both."""
    while line := file.readline(_LONGEST_LINE):
        found.lines += 1
        if len(line) == _LONGEST_LINE and not line.endswith(b"\n"):
            found.long += 1
            while (rest := file.readline(1 << 20)) and not rest.endswith(b"\n"):
                pass
            continue
        yield line.decode("utf-8", "replace")


def _describe(rest: str, found: _Found) -> None:
    entry = [value.strip() for value in rest.split(",")]
    if len(entry) < 4 or len(found.read) >= _MOST_DESCRIPTIONS:
        found.lost += 1
        return
    name, types, fields = entry[2], entry[3], entry[4:]
    if len(types) != len(fields) or not set(types) <= set(CODES):  # of a text they say no more than what is text
        texts = TEXTS.get(name, ())
        types = "".join("f" if f == TIME or f in found.wanted.get(name, ()) and f not in texts else "Z" for f in fields)
    description = described(name.encode(), types.encode(), ",".join(fields).encode(), CODES)
    description = checked(description, found.wanted)
    found.read[description] = None
    if description.damage or description.name not in found.wanted:
        return
    kinds = found.types.setdefault(description.name, [])
    if not kinds or kinds[-1].description != description:  # a type may be described anew
        kinds.append(_Type(description, found.wanted[description.name]))


def _take(name: str, rest: str, found: _Found) -> None:
    """Take a line of a type that is wanted."""
    if found.taken[name] >= most_of(name):
        found.more[name] += 1
        return
    mark = found.types[name][-1].take(found.lines, rest)
    found.taken[name] += bool(mark)
    found.commas += mark == ","
    if not mark:
        found.lost += 1
        found.crowded += rest.count(",") >= len(found.types[name][-1].is_text)


def _columns(kinds: list[_Type]) -> dict[str, np.ndarray]:
    """What the lines of a type hold, however it was described when they were written."""
    parts = [kind.columns() for kind in kinds if kind.lines]
    shared = set.intersection(*(set(part) for part in parts)) if parts else set()
    columns = {name: np.concatenate([part[name] for part in parts]) for name in shared}
    if TIME in columns:
        columns["t"] = columns.pop(TIME) * 1e-6
    return columns


def _findings(found: _Found) -> Iterator[Finding]:
    if found.commas:
        lines = counted(found.commas, "line")
        sentence = f"the numbers have decimal commas ({lines}); fields are told apart by the space behind"
        yield Finding(Severity.INFO, "decimal_commas", sentence)
    if found.lost:
        commas = found.crowded > found.lost / 2
        why = ": most of them have more fields than that, as where numbers have decimal commas" if commas else ""
        sentence = f"of {counted(found.lines, 'line')}, {found.lost:,} without what their type has: left out{why}"
        remedy = "Write the file with decimal points, or give the .BIN" if commas else "Copy the file again"
        yield Finding(Severity.WARNING, "damaged_file", sentence, remedy)
    if found.long:
        lines = counted(found.long, "line is", "lines are")
        sentence = f"{lines} longer than {_LONGEST_LINE:,} bytes, as no message is, and left out"
        yield Finding(Severity.WARNING, "long_lines", sentence, "Copy the file again")
    yield from left_out(found.more)
