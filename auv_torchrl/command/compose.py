"""The settings of a command: its file in ``conf``, the files that its defaults name, then ``key=value``, typed.

It does for the commands that do not train what Hydra does for ``train.py``, and a test holds the one against the other:
the defaults list is read from top to bottom, ``group: option`` takes ``conf/<group>/<option>.yaml``, ``_self_`` is the
file itself, and what comes later wins. Schemas, dataclasses of OmegaConf, refuse keys and types that nothing reads.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException

from auv_torchrl.command.arguments import (
    absent_key,
    refuse_unknown_keys,
    unknown_key,
    unknown_option,
    unreadable,
    without_key,
)
from auv_torchrl.command.errors import BadInput, one_line
from auv_torchrl.command.overrides import Override, OverrideError, read_override
from auv_torchrl.paths import CONF, ENDINGS, PLAIN, config_folders, config_path
from auv_torchrl.yaml_file import YamlFileError, read_yaml

HELP = "help"  # the key of a command's file that is no setting


@dataclass(frozen=True)
class Composed:
    """Settings, and by group the entry that was taken: a name, or a list of them."""

    config: DictConfig
    choices: Mapping[str, Any]


def compose(
    name: str, arguments: Sequence[str] = (), schemas: Mapping[str, type] | None = None, groups: Sequence[str] = ()
) -> Composed:
    """The settings of the command ``name``.

    Args:
        name: of ``conf/<name>.yaml``.
        arguments: ``key=value`` of the command line.
        schemas: by the name that the defaults give it.
        groups: folders of ``conf`` from which ``+group=option`` may add something.

    Raises:
        BadInput: for what cannot be read, or that nothing would read.
    """
    schemas = schemas or {}
    plain = _composed(name, {}, {}, schemas)
    refuse_unknown_keys(lambda: plain.config, arguments, groups)
    overrides = [_read(given, plain, groups) for given in arguments]
    chosen = {one.key: one.value for one in overrides if one.action == "" and one.key in plain.choices}
    added = {one.key: one.value for one in overrides if one.action.startswith("+") and one.key in groups}
    composed = _composed(name, chosen, added, schemas)
    OmegaConf.set_struct(composed.config, True)
    for one in overrides:
        if one.key not in added and one.key not in chosen:
            _apply(composed.config, one, groups)
    return composed


def _read(given: str, plain: Composed, groups: Sequence[str]) -> Override:
    try:
        one = read_override(given)
    except OverrideError as error:
        if "=" not in given:
            raise BadInput(without_key(given)) from error
        raise BadInput(unreadable(given, str(error))) from error
    if one.is_sweep:
        key, _, value = given.partition("=")
        raise BadInput(f"{given} is ambiguous: give {key}=[{value}] for several, or {key}=\"'{value}'\" for one")
    if one.action == "" and one.key in groups and one.key not in plain.choices:
        raise BadInput(f"{one.key} is chosen by default nowhere: give +{given}")
    if one.package is not None or "/" in one.key or one.key.split(".")[0] not in {*plain.config, *groups}:
        raise BadInput(unknown_key(plain.config, one.key, groups))
    return one


def _composed(name: str, chosen: Mapping[str, Any], added: Mapping[str, Any], schemas: Mapping[str, type]) -> Composed:
    content = read_yaml(CONF / f"{name}.yaml", "configuration", plain=False)
    content.pop(HELP, None)
    config, choices = OmegaConf.create(), {}
    for entry in content.pop("defaults"):
        if entry == "_self_":
            config.merge_with(content)
        elif isinstance(entry, str):
            config.merge_with(OmegaConf.structured(schemas[entry]))
        else:
            ((group, option),) = entry.items()
            choices[group] = chosen.get(group, option)
            config.merge_with({group: _content(group, choices[group])})
    for group, options in added.items():
        choices[group] = options
        for option in options if isinstance(options, list) else [options]:
            config.merge_with({group: _content(group, option)})
    return Composed(config, choices)


def _content(group: str, option: Any) -> dict[str, Any]:
    """What is in an entry of a group: a name, or for physical numbers a file anywhere."""
    if not isinstance(option, str):
        raise BadInput(f"{group}={option!r}: give the name of one: {unknown_option(group, str(option))}")
    try:
        return read_yaml(_file(group, option), group, plain=group in PLAIN)
    except (YamlFileError, FileNotFoundError, ValueError) as error:
        raise BadInput(one_line(str(error))) from error


def _file(group: str, option: str) -> Path:
    elsewhere = Path(option).expanduser().absolute()
    inside = [folder / option for folder in config_folders(group)]
    if group in PLAIN and option.endswith(ENDINGS):
        return next((path for path in inside if path.is_file() and not elsewhere.exists()), elsewhere)
    for path in inside:
        if path.with_name(f"{path.name}.yaml").is_dir():
            return path.with_name(f"{path.name}.yaml")  # which is refused as a folder
    try:
        return config_path(group, option)
    except FileNotFoundError as error:
        raise BadInput(unknown_option(group, option)) from error


def _apply(config: DictConfig, one: Override, groups: Sequence[str]) -> None:
    """Set, add or remove one value."""
    try:
        if one.action == "~":
            _remove(config, one, groups)
        elif one.action == "+" and not _may_be_added(config, one):
            raise BadInput(f"{one.given}: it is there already: give {one.given.lstrip('+')} without +")
        else:
            OmegaConf.update(config, one.key, one.value, merge=True, force_add=bool(one.action))
    except (ConfigAttributeError, ConfigKeyError) as error:
        raise BadInput(absent_key(config, one.key, f"+{one.given.lstrip('+')}", groups)) from error
    except OmegaConfBaseException as error:
        why = str(error).split("\n    full_key")[0]
        raise BadInput(one_line(f"cannot set {one.given}: {one.key}: {why}")) from error


def _may_be_added(config: DictConfig, one: Override) -> bool:
    return OmegaConf.select(config, one.key, throw_on_missing=False) is None or isinstance(one.value, dict | list)


def _remove(config: DictConfig, one: Override, groups: Sequence[str]) -> None:
    parent, _, name = one.key.rpartition(".")
    node: Any = OmegaConf.select(config, parent) if parent else config
    if not isinstance(node, DictConfig) or name not in node:
        raise BadInput(unknown_key(config, one.key, groups))
    OmegaConf.set_struct(node, False)
    del node[name]
    OmegaConf.set_struct(node, True)
