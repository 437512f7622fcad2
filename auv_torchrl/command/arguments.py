"""Arguments of a command before they are composed: names of files as people have them, and keys that there are not."""

import re
import shlex
from collections.abc import Callable, Mapping, Sequence
from os.path import exists, expanduser
from typing import Any

from omegaconf import DictConfig, OmegaConf

from auv_torchrl.command.errors import BadInput
from auv_torchrl.command.overrides import Override, OverrideError, Sweep, read_override
from auv_torchrl.paths import CONF, SCHEMA, config_names
from auv_torchrl.settings import choices
from auv_torchrl.vehicle.fields import may_be_left_out

_LISTED = re.compile(r"""\s*("(?:[^"\\]|\\.)*"|'(?:[^'\\]|\\.)*'|[^,]*)\s*(?:,|$)""")  # quoted, or up to a comma


def spelt_out(arguments: Sequence[str], short: Mapping[str, str]) -> list[str]:
    """Arguments with the settings that short names stand for: ``diagnosis=FILE`` as ``diagnosis_file=FILE``."""
    parted = [given.partition("=") for given in arguments]
    return [short.get(key, key) + equals + value for key, equals, value in parted]


def without_config_dir(arguments: Sequence[str]) -> tuple[list[str], str | None]:
    """Arguments without ``--config-dir FOLDER``, and that folder: one's own, for this command."""
    left, folder, rest = [], None, iter(arguments)
    for given in rest:
        flag, equals, value = given.partition("=")
        if flag in ("--config-dir", "-cd"):
            folder = value if equals else next(rest, "")
        else:
            left.append(given)
    return left, folder


def quote_files(arguments: Sequence[str], files: Sequence[str]) -> list[str]:
    """Quote the names of files that Hydra's grammar would refuse, where it is plain what is meant.

    ``log=flüg(1).csv`` becomes ``log='flüg(1).csv'``. What Hydra can read stays as it is; so does a comma without
    brackets, which may mean a list or a sweep, unless there is a file of that name. Names with spaces between are a
    list where one of them is a file and the whole is none: ``make diagnose HEALTHY='a.csv b.csv'``.

    Args:
        arguments: of the command line.
        files: the keys whose values name files or folders.
    """
    sweep = bool({"-m", "--multirun"} & set(arguments))
    return [_quote_argument(given, files, sweep) for given in arguments]


def _quote_argument(given: str, files: Sequence[str], sweep: bool) -> str:
    parts = re.fullmatch(r"(\+{0,2}([\w.]+)=)(.*)", given, re.DOTALL)
    if parts is None or parts[2] not in files or not parts[3]:
        return given
    key, value = parts[1], parts[3]
    if spaced := _spaced(value):
        return f"{key}[{','.join(map(_quoted, spaced))}]"
    parsed = _parse(given)
    if parsed is not None and not parsed.is_sweep:
        plain = isinstance(parsed.value, str | list | dict | None)  # else a name that looks like a number
        return given if plain else key + _quoted(value)
    if "," in value and not sweep and exists(value):
        return key + _quoted(value)
    if parsed is not None:
        return given
    if value.startswith("[") and value.endswith("]"):
        return f"{key}[{','.join(_quoted(entry) for entry in _entries(value[1:-1]))}]"
    if "," in value and sweep:
        return key + ",".join(_quoted(entry) for entry in _entries(value))
    if "," in value:
        listed = ",".join(_entries(value))
        raise BadInput(f"{given} is ambiguous: give {key}[{listed}] for several files, or {key}\"'{value}'\" for one")
    return key + _quoted(value)


def _spaced(value: str) -> list[str]:
    """The files that are named with spaces between, quoted as for a shell; none where that is not what is meant."""
    if value[0] in "[{" or len(value.split()) < 2 or exists(value):
        return []
    try:
        words = shlex.split(value)
    except ValueError:  # an apostrophe in a name
        words = value.split()
    return words if any(exists(expanduser(word)) for word in words) else []


def _parse(given: str) -> Override | None:
    try:
        return read_override(given)
    except OverrideError:
        return None


def _entries(listed: str) -> list[str]:
    return [entry.strip() for entry in _LISTED.findall(listed) if entry.strip()]


def _quoted(name: str) -> str:
    if len(name) > 1 and name[0] == name[-1] and name[0] in "'\"":
        return name
    escaped = re.sub(r"(\\*)('|$)", lambda end: end[1] * 2 + (end[2] and "\\'"), expanduser(name))
    return f"'{escaped}'"


def refuse_unknown_keys(settings: Callable[[], DictConfig], arguments: Sequence[str], groups: Sequence[str]) -> None:
    """Refuse what nothing would read although it composes: ``+key=value`` without such a key, ``group=null``, a schema.

    Args:
        settings: of the command without arguments; composed where an argument adds something.
        arguments: of the command line.
        groups: folders of ``conf`` from which something may be added.

    Raises:
        BadInput: for the first, with the nearest key, or what there is to choose from.
    """
    for given in arguments:
        parsed = _parse(given)
        if parsed is None or parsed.key.split(".")[0].split("/")[0] == "hydra":
            continue
        key, added = parsed.key, parsed.action.startswith("+")
        if added and key not in groups:
            _refuse_unknown(settings(), key, groups)
        if added and parsed.package is not None:
            raise BadInput(f"{given}: give +{key}=... without @{parsed.package}")
        if parsed.action != "~" and (CONF / key).is_dir():
            _refuse_unread(given, key, parsed.value)


def _refuse_unread(given: str, group: str, value: Any) -> None:
    if value is None:
        raise BadInput(f"{given}: there are {', '.join(config_names(group))}")
    for name in value.values if isinstance(value, Sweep) else [value]:
        if str(name).endswith(SCHEMA) and name not in config_names(group):
            raise BadInput(unknown_option(group, str(name)))


def _refuse_unknown(config: DictConfig, key: str, groups: Sequence[str]) -> None:
    node: Any = config
    for name in key.split("."):
        if not isinstance(node, DictConfig) or not _closed(node):
            return  # what reads an open mapping checks it: effects, parameters, entries of a vehicle
        if name not in node:
            raise BadInput(unknown_key(config, key, groups))
        node = node._get_node(name)
    if "/" in key or (CONF / key).is_dir():
        raise BadInput(f"+{key}: it is there already: give {key}=... without +")


def _closed(node: DictConfig) -> bool:
    """Whether its keys are given by a schema."""
    return OmegaConf.get_type(node) not in (dict, None)


def absent_key(config: DictConfig, key: str, given: str, groups: Sequence[str] = ()) -> str:
    """One line about a key that cannot be set: the vehicle's file leaves it out, or there is none."""
    if may_be_left_out(key):
        return f"the vehicle's file leaves out {key}: give {shlex.quote(given)}"
    return unknown_key(config, key, groups)


def unknown_key(config: DictConfig, key: str, groups: Sequence[str] = ()) -> str:
    """One line about a key that there is not, with those that there are."""
    parent, _, name = key.rpartition(".")
    while parent and not isinstance(OmegaConf.select(config, parent), DictConfig):
        parent, _, name = parent.rpartition(".")
    node: Mapping[Any, Any] = OmegaConf.select(config, parent) if parent else config
    known = sorted({str(entry) for entry in node} | (set() if parent else set(groups)))
    return f"no config key {name!r}{f' in {parent}' if parent else ''}: {choices([name], known)}"


def unknown_option(group: str, name: str) -> str:
    """One line about an entry of a group that there is not, with those that there are."""
    return f"no {group} named {name!r}: there are {', '.join(config_names(group))}"


def without_key(given: str) -> str:
    """One line about a word that is neither a file nor ``key=value``."""
    return f"{given} is given without a key: give key=value, --help lists the keys"


def unreadable(given: str, why: str) -> str:
    """One line about a value with signs that mean something else."""
    key, _, value = given.partition("=")
    return f"cannot read {given} ({why}): put a value with signs like , = ( [ in quotes: {key}=\"'{value}'\""
