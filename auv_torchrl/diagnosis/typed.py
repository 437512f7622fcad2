"""Whether what was read from a file has the types that its dataclasses declare."""

import math
import types
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, Union, get_args, get_origin, get_type_hints

INFINITE = ("low", "high")  # ends of an interval, which may be open; every other number is finite


def check_types(value: Any, where: str = "") -> None:
    """Check every field of a dataclass, and of those in it, against its declared type.

    Args:
        value: an instance of a dataclass.
        where: how it is called in messages; nothing for the whole.

    Raises:
        ValueError: naming the first field that holds something else, what it holds and what is wanted.
    """
    hints = get_type_hints(type(value))
    for entry in fields(value):
        if entry.compare:  # the others are not in the file
            _check(getattr(value, entry.name), hints[entry.name], f"{where}{entry.name}", entry.name in INFINITE)


def _check(value: Any, hint: Any, where: str, infinite: bool) -> None:
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        if value is None and type(None) in arguments:
            return
        (hint,) = (argument for argument in arguments if argument is not type(None))
        _check(value, hint, where, infinite)
    elif hint is float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise _wrong(where, value, "a number")
        if math.isnan(value) or (math.isinf(value) and not infinite):
            raise _wrong(where, value, "a finite number")
    elif origin is tuple:
        kinds = arguments[:1] * len(value) if arguments[1:] == (...,) else arguments
        if len(kinds) != len(value):
            raise _wrong(where, value, f"{len(kinds)} entries")
        for index, (each, kind) in enumerate(zip(value, kinds, strict=True)):
            _check(each, kind, f"{where}[{index}]", False)
    elif origin in (dict, Mapping):
        if not isinstance(value, Mapping):
            raise _wrong(where, value, "a mapping")
        for name, each in value.items():
            _check(each, arguments[1], f"{where}.{name}", False)
    elif not isinstance(value, hint) or (hint is int and isinstance(value, bool)):
        raise _wrong(where, value, {str: "a text", int: "a whole number", bool: "true or false"}.get(hint, "a mapping"))
    elif is_dataclass(value):
        check_types(value, f"{where}.")


def _wrong(where: str, value: Any, wanted: str) -> ValueError:
    return ValueError(f"{where} is {repr(value)[:60]} instead of {wanted}")
