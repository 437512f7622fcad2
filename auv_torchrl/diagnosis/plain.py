"""Answers as plain types, which JSON can hold, and back to the dataclasses that they were.

Back by hand, because serializers ignore keys that are unknown (msgspec) or make a number of "0.5" (cattrs), and a file
that somebody changed is to be refused with what it says, where, and what is wanted.
"""

import json
import math
import types
from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from auv_torchrl.files import write_text
from auv_torchrl.quantities import counted

NULL = "null"  # in the metadata of a field: the number that null stands for, alone or in a tuple; all else is finite
Kind = TypeVar("Kind")


def plain(value: Any) -> Any:
    """Lists, dicts, words and Python's own numbers; what is not finite is null, because JSON has no infinity.

    Fields of a dataclass that are not compared are no part of an answer.
    """
    if is_dataclass(value) and not isinstance(value, type):
        return {entry.name: plain(getattr(value, entry.name)) for entry in fields(value) if entry.compare}
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, tuple | list):
        return [plain(entry) for entry in value]
    if isinstance(value, Enum):
        return value.name.lower()
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return int(value) if isinstance(value, np.integer) else value


def write_json(path: Path, content: Any) -> None:
    """Write plain types, whole or not at all."""
    write_text(path, json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n")


def from_plain(kind: type[Kind], content: Any, where: str = "") -> Kind:
    """The instance of a dataclass of which :func:`plain` made the content; what has a default may be missing.

    Args:
        kind: the dataclass; each of its fields says what it holds.
        content: what was read.
        where: how it is called in messages; nothing for the whole.

    Raises:
        KeyError: for an entry that is missing or unknown.
        ValueError: for the first that holds something else, naming it, what it holds and what is wanted.
    """
    assert is_dataclass(kind)
    if not isinstance(content, Mapping):
        raise _wrong(where, content, "a mapping")
    declared, hints = [entry for entry in fields(kind) if entry.compare], get_type_hints(kind)
    needed = [e.name for e in declared if e.default is MISSING and e.default_factory is MISSING]
    missing = [name for name in needed if name not in content]
    if odd := [*missing, *(name for name in content if name not in [entry.name for entry in declared])]:
        raise KeyError(odd[0])
    inside = f"{where}." if where else ""
    null = {entry.name: entry.metadata.get(NULL) for entry in declared}
    return kind(**{name: _read(hints[name], value, f"{inside}{name}", null[name]) for name, value in content.items()})


def _read(hint: Any, content: Any, where: str, null: float | None = None) -> Any:
    """What a field of this type holds; ``null`` is the number that null stands for, where it does."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        if content is None and type(None) in arguments:
            return None
        (hint,) = (argument for argument in arguments if argument is not type(None))
        return _read(hint, content, where)
    if origin is tuple:
        return _read_tuple(arguments, content, where, null)
    if origin in (dict, Mapping):
        if not isinstance(content, Mapping):
            raise _wrong(where, content, "a mapping")
        name_of, kind = arguments
        return {name_of(name): _read(kind, entry, f"{where}.{name}") for name, entry in content.items()}
    if origin is np.ndarray:
        return np.array(content, dtype=float)
    if isinstance(hint, type) and is_dataclass(hint):
        return from_plain(hint, content, where)
    if issubclass(hint, Enum):
        return hint[content.upper()]
    return null if content is None and null is not None else _read_one(hint, content, where)


def _read_tuple(kinds: tuple[Any, ...], content: Any, where: str, null: float | None) -> tuple[Any, ...]:
    if not isinstance(content, list):
        raise _wrong(where, content, "a list")
    if kinds[-1] is ...:
        kinds = kinds[:1] * len(content)
    if len(kinds) != len(content):
        raise _wrong(where, content, counted(len(kinds), "entry", "entries"))
    entries = enumerate(zip(kinds, content, strict=True))
    return tuple(_read(kind, entry, f"{where}[{i}]", null) for i, (kind, entry) in entries)


def _read_one(kind: type, content: Any, where: str) -> Any:
    """A number, a text or a truth as it is; a whole number is a number, a truth is none."""
    allowed = (int, float) if kind is float else (kind,)
    if not isinstance(content, allowed) or (isinstance(content, bool) and kind is not bool):
        words = {float: "a number", int: "a whole number", str: "a text", bool: "true or false"}
        raise _wrong(where, content, words[kind])
    if kind is float and not math.isfinite(content):
        raise _wrong(where, content, "a finite number")
    return content


def _wrong(where: str, value: Any, wanted: str) -> ValueError:
    return ValueError(f"{where} is {repr(value)[:60]} instead of {wanted}")
