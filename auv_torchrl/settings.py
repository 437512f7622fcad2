"""Settings as dataclasses whose fields declare what they may be, checked in one place.

A field says its range where it says its type: ``gamma: Annotated[float, In("[0, 1)")]``. Without a range a number may
be any that is finite.
"""

import difflib
import math
import types
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin, get_type_hints

from auv_torchrl.paths import config_path
from auv_torchrl.yaml_file import read_yaml

Settings = TypeVar("Settings")


@dataclass(frozen=True)
class In:
    """The interval that a number, or each of several, lies in, as mathematics writes it: ``[0, 1)``, ``(0, inf)``."""

    interval: str
    unit: str = ""

    def __contains__(self, value: float) -> bool:
        low, high = self._ends
        above = value >= low if self.interval[0] == "[" else value > low
        return above and (value <= high if self.interval[-1] == "]" else value < high)

    def __str__(self) -> str:
        low, high = (end.strip() for end in self.interval[1:-1].split(","))
        unit = f" {self.unit}" if self.unit else ""
        if float(high) - float(low) <= 1:  # shares and the like
            return f"in {self.interval}{unit}"
        words = (
            [f"of {low}{unit} or more" if self.interval[0] == "[" else f"above {low}{unit}"] if low != "-inf" else []
        )
        if high != "inf":
            words.append(f"at most {high}{unit}" if self.interval[-1] == "]" else f"below {high}{unit}")
        return " and ".join(words) or "that is finite"

    @property
    def _ends(self) -> tuple[float, float]:
        low, high = self.interval[1:-1].split(",")
        return float(low), float(high)


@dataclass(frozen=True)
class OneOf:
    """The words that a setting may be."""

    words: tuple[str, ...]


@dataclass(frozen=True)
class Entries:
    """How many entries a list may have."""

    least: int
    most: int


FINITE = In("(-inf, inf)")
Seed = Annotated[int, In("[0, 2147483647]")]  # what numpy and torch both take, times the factor of the trainer


def check(kind: type, values: Mapping[str, Any], where: str = "") -> None:
    """Refuse values that the fields of the dataclass ``kind`` do not allow.

    Args:
        kind: declares the fields, with :class:`In`, :class:`OneOf` and :class:`Entries` in ``Annotated``.
        values: by name of the field.
        where: what the fields belong to, for the message: ``agent`` for ``agent.gamma``; empty for none.

    Raises:
        ValueError: for the first value of another type or outside its range, with the key and what to give.
    """
    for name, hint in get_type_hints(kind, include_extras=True).items():
        if name in values and not _allowed(hint, values[name]):
            key = f"{where}.{name}" if where else name
            value = list(values[name]) if isinstance(values[name], tuple) else values[name]
            raise ValueError(f"{key} is {value!r}: give {_wanted(hint)}")


def check_fields(settings: Any, where: str) -> None:
    """:func:`check` for an instance; what ``__post_init__`` calls."""
    check(type(settings), {entry.name: getattr(settings, entry.name) for entry in fields(settings)}, where)


def choices(given: Iterable[object], known: Iterable[str]) -> str:
    """``there are A, B (did you mean B?)``: what there is instead of names that there are not, and the nearest."""
    known = list(known)
    near = [name for wrong in given for name in difflib.get_close_matches(str(wrong), known, n=1)]
    return f"there are {', '.join(known)}" + (f" (did you mean {', '.join(near)}?)" if near else "")


def read_settings(kind: type[Settings], group: str, name: str, overrides: Mapping[str, Any] | None = None) -> Settings:
    """Read ``conf/<group>/<name>.yaml`` into the dataclass ``kind`` and replace some of its values.

    Raises:
        FileNotFoundError: for an unknown name.
        ValueError: for a file that cannot be used, or an unknown, missing or impossible setting.
    """
    content = read_yaml(config_path(group, name), group)
    return settings_of(kind, {**content, **(overrides or {})}, group)


def settings_of(kind: type[Settings], content: Mapping[str, Any], group: str) -> Settings:
    """The dataclass ``kind`` from a mapping that names each of its fields.

    Raises:
        ValueError: for an unknown, missing or impossible setting.
    """
    assert is_dataclass(kind)
    known = [entry.name for entry in fields(kind)]
    if odd := set(content) - set(known):
        raise ValueError(f"{group}: unknown settings {sorted(map(str, odd))}: {choices(odd, known)}")
    if missing := set(known) - set(content):
        raise ValueError(f"{group}: settings {', '.join(sorted(missing))} are missing")
    values = {name: tuple(value) if isinstance(value, list) else value for name, value in content.items()}
    check(kind, values, group)
    return kind(**values)


def _allowed(hint: Any, value: Any) -> bool:
    hint, declared = _split(hint)
    if get_origin(hint) in (Union, types.UnionType):
        return any(_allowed(Annotated[(option, *declared)] if declared else option, value) for option in get_args(hint))
    if hint is type(None):
        return value is None
    if get_origin(hint) is tuple:
        return _allowed_entries(get_args(hint), declared, value)
    if hint in (int, float):
        kinds = (int,) if hint is int else (int, float)
        if isinstance(value, bool) or not isinstance(value, kinds) or not math.isfinite(value):
            return False
    elif hint in (bool, str) and not isinstance(value, hint):
        return False
    return all(
        value in (rule.words if isinstance(rule, OneOf) else rule) for rule in declared if not isinstance(rule, Entries)
    )


def _allowed_entries(kinds: tuple[Any, ...], declared: tuple[Any, ...], value: Any) -> bool:
    if not isinstance(value, tuple | list):
        return False
    count = next((rule for rule in declared if isinstance(rule, Entries)), None)
    if kinds[-1] is not Ellipsis:
        count = Entries(len(kinds), len(kinds))
    if count is not None and not count.least <= len(value) <= count.most:
        return False
    rules = tuple(rule for rule in declared if not isinstance(rule, Entries))
    return all(_allowed(Annotated[(kinds[0], *rules)] if rules else kinds[0], entry) for entry in value)


def _wanted(hint: Any) -> str:
    """What a field takes, in words: ``a whole number of 1 or more``."""
    hint, declared = _split(hint)
    if get_origin(hint) in (Union, types.UnionType):
        options = [option for option in get_args(hint) if option is not type(None)]
        words = [_wanted(Annotated[(option, *declared)] if declared else option) for option in options]
        return " or ".join([*words, "null"] if len(options) < len(get_args(hint)) else words)
    if get_origin(hint) is tuple:
        return _wanted_entries(get_args(hint), declared)
    if chosen := next((rule for rule in declared if isinstance(rule, OneOf)), None):
        return " or ".join(chosen.words)
    interval = next((rule for rule in declared if isinstance(rule, In)), FINITE)
    names = {int: f"a whole number {interval}", float: f"a number {interval}", bool: "true or false", str: "a word"}
    return names.get(hint, "another value")


def _wanted_entries(kinds: tuple[Any, ...], declared: tuple[Any, ...]) -> str:
    count = next((rule for rule in declared if isinstance(rule, Entries)), None)
    rules = tuple(rule for rule in declared if not isinstance(rule, Entries))
    least, most = (len(kinds), len(kinds)) if kinds[-1] is not Ellipsis else (0, 0)
    if count is not None:
        least, most = count.least, count.most
    how_many = f"{least} to {most} " if least < most else f"{least} " if least else ""
    return f"a list of {how_many}entries, each {_wanted(Annotated[(kinds[0], *rules)] if rules else kinds[0])}"


def _split(hint: Any) -> tuple[Any, tuple[Any, ...]]:
    if get_origin(hint) is Annotated:
        kind, *declared = get_args(hint)
        return kind, tuple(declared)
    return hint, ()
