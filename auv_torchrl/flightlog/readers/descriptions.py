"""Descriptions of ArduPilot's messages (FMT): what of them can be used, and what is damaged in those that cannot.

One bit that flips in a description changes how all messages of its type are read. A message whose description cannot
be meant so is left out, and a finding says what is wrong with it.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

from auv_torchrl.flightlog.findings import Finding, Severity
from auv_torchrl.flightlog.streams.stream import DAMAGED
from auv_torchrl.quantities import counted
from auv_torchrl.text import printable

Wanted = Mapping[str, tuple[str, ...]]  # fields by type of message

TIME = "TimeUS"
TEXTS = {"PARM": ("Name",), "MSG": ("Message",)}  # fields that are no number
EVENTS = ("PARM", "MSG", "VER", "MODE", "ARM", "EV")  # written when something happens, each handled by itself
MOST_EVENTS = 100_000  # of a type that are read; a vehicle has 1,500 parameters and writes them at each start
MOST_SAMPLES = 5_000_000  # of a type of the others, as many as rows of a table: 3.5 hours at 400 Hz
TEXT_CODES, _ARRAY = "nNZ", "a"  # types of fields
_NAME = re.compile(rb"[A-Za-z][A-Za-z0-9_]{0,3}\0*")
_COLUMNS = re.compile(rb"[A-Za-z0-9_,]+\0*")
_COMMON = (TIME, "C", "I")  # fields that many types have
_SIMILAR = 0.5  # share of the other fields of a type that a damaged description must have, too, to be meant for it
_NO_SLIPS = ("NKF1", "NKF2", "NKF3", "NKF4", "NKQ", "RCI2")  # types of firmware that are a letter off a wanted one


class Description(NamedTuple):
    """A description as it was found; its texts are made printable."""

    name: str
    fields: tuple[str, ...]
    types: str  # code of each field
    damage: str = ""  # why it cannot be used; empty where it can


def described(name: bytes, types: bytes, columns: bytes, codes: Iterable[str]) -> Description:
    """The description that three texts of fixed length make, all three behind zeros; ``codes`` are known types."""
    fields = tuple(printable(column) for column in columns.rstrip(b"\0").decode("latin-1").split(","))
    spelt = types.rstrip(b"\0").decode("latin-1")
    plain = printable(name.rstrip(b"\0").decode("latin-1"))
    damage = ""
    if not _NAME.fullmatch(name):
        damage = f"its name is '{plain}'"
    elif not _COLUMNS.fullmatch(columns):
        damage = f"its columns are '{printable(','.join(fields), 60)}'"
    elif unknown := sorted(set(spelt) - set(codes)):
        damage = f"nothing has the type '{printable(unknown[0])}'"
    elif len(fields) != len(spelt):
        damage = f"it has {counted(len(fields), 'column')} and types for {len(spelt)}"
    elif len(set(fields)) != len(fields) or "" in fields:
        damage = "two of its columns have one name"
    return Description(plain, fields, spelt, damage)


def checked(found: Description, wanted: Wanted) -> Description:
    """The description, with what is wrong with the fields that are ``wanted`` of it."""
    if found.damage or found.name not in wanted:
        return found
    fields = wanted[found.name]
    for field, code in zip(found.fields, found.types, strict=True):
        is_text = field in TEXTS.get(found.name, ())
        if field in fields and (code == _ARRAY or (code in TEXT_CODES) != is_text):
            kind = "an array" if code == _ARRAY else "text" if code in TEXT_CODES else "a number"
            return found._replace(damage=f"it says that {field} is {kind}")
    for place, field in enumerate(found.fields):
        if meant := _meant_field(field, place, found.fields, fields):
            return found._replace(damage=f"it has a column {field} in place of {meant}")
    return found if TIME in found.fields else found._replace(damage=f"it has no column {TIME}")


def _meant_field(field: str, place: int, there: Sequence[str], wanted: Sequence[str]) -> str:
    """The field that is wanted and not there, and that one flipped bit makes ``field`` of; empty for none."""
    if field in wanted:
        return ""
    near = (other for other in wanted if other not in there and _bits(field, other) == 1)
    # letters alone are many, and alike; the one that is wanted numbers the sensor, and stands behind the time
    return next((other for other in near if len(other) > 1 or place == 1), "")


def _bits(one: str, other: str) -> int:
    """Bits by which two short texts of one length differ; more than one for others."""
    if len(one) != len(other):
        return 8
    return sum((ord(a) ^ ord(b)).bit_count() for a, b in zip(one, other, strict=True))


def damaged(found: Iterable[Description], wanted: Wanted) -> Iterator[Finding]:
    """Findings about the descriptions of a file that bear on what is ``wanted``.

    A type whose description is sound in one place is read by that one.
    """
    found = tuple(found)
    sound = {entry.name for entry in found if not entry.damage}
    for entry in found:
        meant = entry.name if entry.name in wanted else _meant_type(entry, wanted, sound)
        if not meant or not (entry.damage or entry.name != meant):
            continue
        damage = entry.damage or f"its name is '{entry.name}'"
        left = f"{meant} is read as it is described elsewhere" if meant in sound else f"{meant} is left out"
        sentence = f"the description of the message {meant} is damaged, {damage}: {left}"
        yield Finding(Severity.WARNING, DAMAGED, sentence, "Copy the file from the vehicle again")


def _meant_type(entry: Description, wanted: Wanted, sound: set[str]) -> str:
    """The wanted type, not described in the file otherwise, that a description under another name is meant for."""
    for name, fields in wanted.items():
        own = set(fields) - set(_COMMON)
        similar = len(own & set(entry.fields)) >= _SIMILAR * len(own)
        if name not in sound and similar and (entry.damage.startswith("its name") or _is_slip(entry.name, name)):
            return name
    return ""


def _is_slip(name: str, meant: str) -> bool:
    """Whether one character of a name is damaged; firmware itself numbers its types: BARO, BAR2."""
    numbered = name[-1:] in set("0123456789") and meant[-1] not in set("0123456789")
    apart = sum(a != b for a, b in zip(name.ljust(4), meant.ljust(4), strict=True)) if len(name) <= 4 else 4
    return apart == 1 and not numbered and name not in _NO_SLIPS
