"""Errors of Hydra and OmegaConf as one line with the keys that there are."""

import re
from functools import cache

import hydra
from hydra.errors import OverrideParseException
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from auv_torchrl.command.arguments import absent_key, unknown_option, unreadable, without_key
from auv_torchrl.command.errors import one_line
from auv_torchrl.paths import CONF


@cache
def composed(config_name: str) -> DictConfig:
    """The settings of a command without arguments."""
    with hydra.initialize_config_dir(version_base="1.3", config_dir=str(CONF)):
        return hydra.compose(config_name)


def explain(config_name: str, error: Exception) -> str:
    """One line out of an error of Hydra or OmegaConf, with the keys there are."""
    if isinstance(error, OverrideParseException):
        if "=" not in error.override:
            return without_key(error.override)
        return unreadable(error.override, one_line(str(error).split("\nSee https")[0]))
    text = str(error).split("Config search path")[0].split("\nSee https")[0].split("\n    full_key")[0]
    if isinstance(error, OmegaConfBaseException) and error.full_key and error.full_key not in text:
        text = f"{error.full_key}: {text}"
    if missing := re.search(r"Could not override '([^']+)'\.\s*To append to your config use (.*)", text):
        return absent_key(composed(config_name), missing[1], missing[2])
    if absent := re.search(r"Could not (?:find|load) '([^']+)/([^/']+)'", text):
        return unknown_option(absent[1], absent[2])
    cause = error.__cause__
    reason = str(cause).split("\n    full_key")[0] if cause is not None else ""
    return one_line(f"{text.strip()}: {reason}" if reason and reason not in text else text)
