"""A plain command line, ``auv-diagnose dive.BIN --healthy sound.BIN``, as the ``key=value`` that it stands for.

Files stand by themselves and belong to one key. ``--name`` is the setting ``name`` of the command's file in ``conf``, a
``-`` in it a ``_``: true by itself where the file has true or false, as many values as follow where it has a list, and
one value elsewhere. ``key=value`` is handed on as it is.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from enum import Enum
from functools import cached_property
from glob import glob
from os.path import exists, expanduser
from pathlib import Path
from typing import Any

from auv_torchrl.command.errors import BadInput
from auv_torchrl.command.overrides import OverrideError, read_override
from auv_torchrl.paths import CONF, config_names
from auv_torchrl.yaml_file import read_yaml

NO_SETTINGS = ("defaults", "help", "hydra")  # entries of a command's file that are none
_OVERRIDE = re.compile(r"(\+{0,2}[A-Za-z_][\w.@/-]*=|~[A-Za-z_])")
_SIGNS = "*?["
_OF_HYDRA = ("-m", "--multirun")


class Takes(Enum):
    """What follows an option."""

    NOTHING = "nothing"
    ONE = "a value"
    SEVERAL = "values"


@dataclass(frozen=True)
class CommandLine:
    """What may be on the command line of a command.

    Args:
        name: of ``conf/<name>.yaml``.
        files: keys whose values name files or folders.
        bare: the key that files without one belong to; empty where there is none.
        words: what may stand for a file under that key.
        groups: folders of ``conf`` from which ``+group=option`` may add something; ``--group`` does the same.
    """

    name: str
    files: tuple[str, ...] = ("output",)
    bare: str = ""
    words: tuple[str, ...] = ()
    groups: tuple[str, ...] = ()

    @cached_property
    def content(self) -> dict[str, Any]:
        """The command's file."""
        return read_yaml(CONF / f"{self.name}.yaml", "configuration", plain=False)

    @cached_property
    def options(self) -> Mapping[str, Takes]:
        """By name of a setting, what follows it."""
        found = {**dict.fromkeys(self.chosen, Takes.ONE), **dict.fromkeys(self.groups, Takes.SEVERAL)}
        for key, value in self.content.items():
            if key not in NO_SETTINGS and not isinstance(value, dict):
                several = isinstance(value, list) or key == self.bare
                found[key] = Takes.NOTHING if isinstance(value, bool) else Takes.SEVERAL if several else Takes.ONE
        return found

    @cached_property
    def chosen(self) -> set[str]:
        """The groups of ``conf`` that an entry is taken of in any case."""
        return {group for entry in self.content["defaults"] if isinstance(entry, dict) for group in entry}

    @property
    def keys(self) -> dict[str, list[str]]:
        """By option, what there is to choose; an empty list for files, numbers and words."""
        groups = {*self.chosen, *self.groups}
        found = {name: config_names(name) if name in groups else [] for name in self.options}
        return {f"--{name.replace('_', '-')}": names for name, names in found.items()} | {"--help": [], "--version": []}

    def overrides(self, words: Sequence[str]) -> list[str]:
        """The ``key=value`` that the words of a command line stand for.

        Raises:
            BadInput: for an option that there is not, or that lacks its value, and for files that belong to no key.
        """
        given: dict[str, list[str]] = {}
        plain: list[str] = []
        for option, value in self._parted(words):
            if option is None:
                plain.append(value)
            else:
                given.setdefault(option, []).extend([value] if value else [])
        for word in plain:
            if (key := word.partition("=")[0].lstrip("+")) in given:
                raise BadInput(f"{key} is given twice, as {word} and without its key: give it once")
        return [*plain, *(self._override(*entry) for entry in given.items())]

    def _parted(self, words: Sequence[str]) -> list[tuple[str | None, str]]:
        """Each word with the option that it belongs to, None for none; an option without a value stands alone."""
        parted: list[tuple[str | None, str]] = []
        at, rest = 0, False  # rest: after --, where all are files
        while at < len(words):
            word, at = words[at], at + 1
            if word == "--" and not rest:
                rest = True
            elif not rest and word.startswith("-") and len(word) > 1:
                option, follow = self._followed(word, words[at:])
                at += len(follow) * ("=" not in word)
                parted += [(option, value) for value in follow] or [(option, "")]
            elif is_override(word) and not rest:
                parted.append((None, word))
            elif self._is_file(word):
                parted += [(self.bare, name) for name in self._named(word)]
            else:
                raise BadInput(f"{word} is given without a key: give key=value, --help lists the keys")
        return parted

    def _followed(self, word: str, ahead: Sequence[str]) -> tuple[str, list[str]]:
        """The setting that an option stands for, and its values."""
        option, equals, value = word.removeprefix("--").partition("=")
        option = option.replace("-", "_")
        if word in _OF_HYDRA:
            raise BadInput(f"{word}: auv-{self.name} has no sweeps, auv-train has: call it once for each value")
        if not word.startswith("--") or option not in self.options:
            raise BadInput(self._no_option(word))
        takes = self.options[option]
        if equals:
            return option, [value]
        if takes is Takes.NOTHING:
            return option, []
        values: list[str] = []
        for next_word in ahead:
            if (next_word.startswith("-") and not _is_number(next_word)) or is_override(next_word):
                break
            values.append(next_word)
            if takes is Takes.ONE:
                break
        if not values:
            raise BadInput(f"--{option.replace('_', '-')} needs {takes.value}: --help says which")
        return option, values

    def _no_option(self, word: str) -> str:
        known = [f"--{name.replace('_', '-')}" for name in self.options]
        near = get_close_matches(word, known, n=1)
        return f"{word}: there is no such option" + (f": did you mean {near[0]}?" if near else ", --help lists them")

    def _override(self, option: str, values: list[str]) -> str:
        """``key=value`` of an option and all that was given for it."""
        sign = "+" if option in self.groups and option not in self.chosen else ""
        takes = self.options[option]
        if option in self.files:
            values = [name for value in values for name in self._named(value)]
            quoted = [value if value[:1] in ("[", "{") or value == "null" else _quoted(value) for value in values]
        else:
            quoted = [value if _is_readable(value) else _quoted(value) for value in values]
        if takes is Takes.NOTHING:
            return f"{option}={values[-1] if values else 'true'}"
        if takes is Takes.ONE and len(quoted) > 1:
            raise BadInput(f"--{option.replace('_', '-')} takes one value: {' and '.join(values)} were given")
        return f"{sign}{option}={quoted[0] if len(quoted) == 1 else '[' + ','.join(quoted) + ']'}"

    def _is_file(self, word: str) -> bool:
        """Whether a bare word names a file, though perhaps none that is there."""
        named = "/" in word or "\\" in word or bool(Path(word).suffix) or exists(expanduser(word))
        return bool(self.bare) and (named or word in self.words or any(sign in word for sign in _SIGNS))

    def _named(self, word: str) -> list[str]:
        """The files that a word names: itself, or what a pattern that the shell has left matches.

        Raises:
            BadInput: for a pattern that matches nothing.
        """
        name = expanduser(word)
        if any(sign in name for sign in _SIGNS) and not exists(name) and name[0] not in "[{":
            if not (found := sorted(glob(name))):
                raise BadInput(f"no file matches {word}: give the name of a file that is there")
            return found
        return [name]


def is_override(word: str) -> bool:
    """Whether a word is ``key=value`` rather than the name of a file."""
    return bool(_OVERRIDE.match(word)) and not exists(word)


def _is_number(word: str) -> bool:
    return bool(re.fullmatch(r"-[\d.]+(e[+-]?\d+)?", word))


def _is_readable(value: str) -> bool:
    try:
        return not read_override(f"key={value}").is_sweep
    except OverrideError:
        return False


def _quoted(name: str) -> str:
    escaped = re.sub(r"(\\*)('|$)", lambda end: end[1] * 2 + (end[2] and "\\'"), name)
    return f"'{escaped}'"
