"""Types of everything that conf/diagnose.yaml holds, so that a misspelt key or a wrong type is an error."""

from dataclasses import dataclass
from typing import Any

from hydra.core.config_store import ConfigStore
from omegaconf import MISSING


@dataclass
class DiagnoseSchema:
    """Types of ``conf/diagnose.yaml``; the comments are there."""

    log: Any = MISSING
    vehicle: dict[str, Any] = MISSING
    diagnosis: dict[str, Any] = MISSING
    healthy: Any = MISSING
    test: Any = MISSING
    extra: Any = MISSING
    modes: Any = MISSING
    params: Any = MISSING
    system: Any = MISSING
    trust_log: bool = MISSING
    dives: bool = MISSING
    reference: int = MISSING
    each: str = MISSING
    dives_per_false_alarm: float = MISSING
    jobs: int = MISSING
    store: str = MISSING
    output: str = MISSING


def register() -> None:
    """Make the schema known to Hydra as ``diagnose_schema``."""
    ConfigStore.instance().store("diagnose_schema", DiagnoseSchema)
