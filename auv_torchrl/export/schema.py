"""Types of everything in conf/export.yaml: a misspelt key or a wrong type is an error."""

from dataclasses import dataclass
from typing import Any

from hydra.core.config_store import ConfigStore
from omegaconf import MISSING


@dataclass
class ExportSchema:
    """Types of ``conf/export.yaml``; the comments are there."""

    policy: str = MISSING
    adapter: Any = MISSING
    output: str = MISSING


def register() -> None:
    """Make the schema known to Hydra as ``export_schema``."""
    ConfigStore.instance().store("export_schema", ExportSchema)
