"""Types of everything in conf/export.yaml: a misspelt key or a wrong type is an error."""

from dataclasses import dataclass
from typing import Any

from omegaconf import MISSING


@dataclass
class ExportSchema:
    """Types of ``conf/export.yaml``; the comments are there."""

    policy: str | None = MISSING
    adapter: Any = MISSING
    vehicle: str | None = MISSING
    format: str | None = MISSING
    output: str = MISSING


SCHEMAS = {"export_schema": ExportSchema}  # by the name that conf/export.yaml gives it
