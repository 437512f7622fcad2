"""Settings of a dataclass from a file of ``conf/``."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, TypeVar

import yaml

from auv_torchrl.paths import config_path

Settings = TypeVar("Settings")


def read_settings(kind: type[Settings], group: str, name: str, overrides: Mapping[str, Any] | None = None) -> Settings:
    """Read ``conf/<group>/<name>.yaml`` into the dataclass ``kind`` and replace some of its values.

    Raises:
        FileNotFoundError: for an unknown name.
        ValueError: for an unknown, missing or impossible setting.
    """
    settings = {**yaml.safe_load(config_path(group, name).read_text()), **(overrides or {})}
    known = [field.name for field in fields(kind)]  # type: ignore[arg-type]
    if unknown := set(settings) - set(known):
        raise ValueError(f"{group} {name}: unknown settings {sorted(unknown)}: there are {', '.join(known)}")
    if missing := set(known) - set(settings):
        raise ValueError(f"{group} {name}: settings {sorted(missing)} are missing")
    return kind(**settings)
