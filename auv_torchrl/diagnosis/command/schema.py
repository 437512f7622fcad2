"""Types of everything in conf/diagnose.yaml and conf/calibrate.yaml: a misspelt key or a wrong type is an error."""

from dataclasses import dataclass
from typing import Any

from omegaconf import MISSING


@dataclass
class LogsSchema:
    """Types of what both commands read logs and a vehicle by."""

    vehicle: dict[str, Any] = MISSING
    diagnosis: dict[str, Any] = MISSING
    healthy: Any = MISSING
    extra: Any = MISSING
    modes: Any = MISSING
    params: Any = MISSING
    mapping: str | None = MISSING
    system: Any = MISSING
    trust_log: bool = MISSING
    output: str = MISSING


@dataclass
class DiagnoseSchema(LogsSchema):
    """Types of ``conf/diagnose.yaml``; the comments are there."""

    log: Any = MISSING
    test: Any = MISSING
    dives: bool = MISSING
    alike: bool = MISSING
    explain: bool = MISSING
    reference: int = MISSING
    each: str = MISSING
    dives_per_false_alarm: float = MISSING
    jobs: int = MISSING
    store: str = MISSING


@dataclass
class CalibrateSchema(LogsSchema):
    """Types of ``conf/calibrate.yaml``; the comments are there."""

    replace: bool = MISSING


# by the name that conf/diagnose.yaml and conf/calibrate.yaml give them
SCHEMAS = {"diagnose_schema": DiagnoseSchema, "calibrate_schema": CalibrateSchema}
