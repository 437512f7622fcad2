"""``key=value`` of a command line: which key, what is done with it, and which value. The grammar is Hydra's.

``a.b=3``, ``+scenario=[swap,current]``, ``++a.b={c: 1}``, ``~a.b``, ``group@package=name``. A value is a word, a
number, ``true``, ``null``, a text in quotes, a list or a mapping; values with commas between are a sweep. The
functions of Hydra, as ``glob(*)``, are recognised, and left to it.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

_KEY = re.compile(r"(\+{0,2}|~)([\w$./-]*)(?:@([\w$./-]*))?(?:(=)[ \t]*(.*))?", re.DOTALL | re.ASCII)
_WORD = r"[A-Za-z_$][\w$-]*"
_KEYS = re.compile(rf"|{_WORD}|(?:{_WORD}|\d+)(?:\.(?:{_WORD}|\d+))+|[A-Za-z_][\w-]*(?:/[A-Za-z_][\w-]*)+", re.ASCII)
_INTEGER = r"(?:0|[1-9](?:_?[0-9])*)"
_POINTED = rf"(?:{_INTEGER}\.|{_INTEGER}?\.[0-9](?:_?[0-9])*)"
_INTEGERS = re.compile(rf"[+-]?{_INTEGER}")
_FLOATS = re.compile(
    rf"[+-]?(?:{_POINTED}|(?:{_POINTED}|{_INTEGER})[eE][+-]?[0-9](?:_?[0-9])*|[Ii][Nn][Ff]|[Nn][Aa][Nn])"
)
_QUOTED = re.compile(r""""((?:\\\\)*|.*?[^\\](?:\\\\)*)"|'((?:\\\\)*|.*?[^\\](?:\\\\)*)'""", re.DOTALL)
_PLAIN = re.compile(r"(?:\$\{[^}]+\}|[\w/\-+.$%*@?|: \t]|\\[\\()\[\]{}:=, \t]|\\)+", re.ASCII)
_NAME = re.compile(r"(?:[\w/\-+.$%*@?| \t]|\\[\\()\[\]{}:=, \t]|\\)+", re.ASCII)
_ESCAPED = re.compile(r"\\([\\()\[\]{}:=, \t])")
_FUNCTION = re.compile(r"(bool|choice|extend_list|float|glob|int|interval|json_str|range|shuffle|sort|str|tag)[ \t]*\(")
_WORDS: dict[str, Any] = {"true": True, "false": False, "null": None}


class OverrideError(ValueError):
    """What was given is no ``key=value``, or its value cannot be read; the message says why."""


@dataclass(frozen=True)
class Function:
    """A function of Hydra, such as ``glob(*)``, unread."""

    text: str


@dataclass(frozen=True)
class Sweep:
    """Several values with commas between."""

    values: tuple[Any, ...]


@dataclass(frozen=True)
class Override:
    """One ``key=value``."""

    given: str
    action: str  # "" sets, "+" adds, "++" sets or adds, "~" removes
    key: str  # ``a.b``, or the name of a group
    value: Any
    package: str | None = None  # of a group: where its content goes

    @property
    def is_sweep(self) -> bool:
        """Whether several values, or a function of Hydra, are given."""
        return isinstance(self.value, Sweep | Function)


def read_override(given: str) -> Override:
    """One argument of a command line.

    Raises:
        OverrideError: where it has no key, or a value that cannot be read.
    """
    parts = _KEY.fullmatch(given)
    if parts is None or not _KEYS.fullmatch(parts[2]) or (parts[4] is None and parts[1] != "~"):
        raise OverrideError("it is no key=value")
    text = parts[5]
    value = _Reader(text).whole() if text else ("" if parts[4] else None)
    return Override(given, parts[1], parts[2], value, parts[3])


class _Reader:
    """Reads one value from left to right."""

    def __init__(self, text: str) -> None:
        self.text, self.at = text, 0

    def whole(self) -> Any:
        """The value, or the sweep, that the text is.

        Raises:
            OverrideError: naming the sign that no value has in that place.
        """
        values = [self._element()]
        while self._takes(","):
            values.append(self._element())
        if self.at < len(self.text):
            raise self._unexpected()
        return values[0] if len(values) == 1 else Sweep(tuple(values))

    def _element(self) -> Any:
        sign = self.text[self.at : self.at + 1]
        if sign == "[":
            return self._listed("]", self._element)
        if sign == "{":
            return dict(self._listed("}", self._pair))
        if found := _FUNCTION.match(self.text, self.at):
            return self._function(found.end())
        return self._primitive()

    def _listed(self, end: str, entry: Callable[[], Any]) -> list[Any]:
        self.at += 1
        self._skip()
        found: list[Any] = []
        while not self._takes(end, after=False):
            if found and not self._takes(","):
                raise self._unexpected()
            found.append(entry())
        return found

    def _pair(self) -> tuple[Any, Any]:
        name = _NAME.match(self.text, self.at)
        if name is None:
            raise self._unexpected()
        self.at = name.end()
        if not self._takes(":"):
            raise self._unexpected()
        return _typed(name[0].strip(" \t")), self._element()

    def _function(self, begin: int) -> Function:
        depth, at = 1, begin
        while depth and at < len(self.text):
            depth += {"(": 1, ")": -1}.get(self.text[at], 0)
            at += 1
        if depth:
            raise OverrideError("a ) is missing")
        text, self.at = self.text[self.at : at], at
        return Function(text)

    def _primitive(self) -> Any:
        if quoted := _QUOTED.match(self.text, self.at):
            self.at = quoted.end()
            mark, inside = quoted[0][0], quoted[1] if quoted[1] is not None else quoted[2]
            return _unescaped(inside, mark)
        if (plain := _PLAIN.match(self.text, self.at)) and (words := plain[0].strip(" \t")):
            self.at = plain.end()
            return _typed(words)
        raise self._unexpected()

    def _takes(self, sign: str, after: bool = True) -> bool:
        before = self.at
        self._skip()
        if self.text[self.at : self.at + 1] != sign:
            self.at = before
            return False
        self.at += 1
        if after:
            self._skip()
        return True

    def _skip(self) -> None:
        while self.text[self.at : self.at + 1] in (" ", "\t"):
            self.at += 1

    def _unexpected(self) -> OverrideError:
        sign = self.text[self.at : self.at + 1]
        return OverrideError(f"unexpected {sign!r} in it" if sign else "it ends too early")


def _typed(word: str) -> Any:
    if word.lower() in _WORDS:
        return _WORDS[word.lower()]
    if _INTEGERS.fullmatch(word):
        return int(word)
    if _FLOATS.fullmatch(word):
        return float(word)
    return word if "${" in word else _ESCAPED.sub(r"\1", word)


def _unescaped(inside: str, mark: str) -> str:
    """The text between quotes: a backslash stands for itself but before a quote and at the end."""
    return re.sub(rf"(\\+)(?={mark}|\Z)", lambda found: "\\" * (len(found[1]) // 2), inside)
