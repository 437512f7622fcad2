"""What a command was started with, beside its settings."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Run:
    """One start of a command."""

    folder: Path  # of the results, claimed; the working directory for a command that has none
    overrides: tuple[str, ...] = ()  # key=value of the command line
    choices: Mapping[str, Any] = field(default_factory=dict)  # by group of conf, the entry that was taken
