"""From a composed config to the logs and the vehicle that a diagnosis needs, checked."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hydra.core.config_store import ConfigStore
from omegaconf import MISSING, DictConfig, OmegaConf

from auv_torchrl.diagnosis.calibrate.uncertainty import Coefficient, read_uncertainty
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.settings import read_settings
from auv_torchrl.flightlog import FlightLog, FlightLogError, Severity, join, read_flightlog
from auv_torchrl.flightlog.streams.options import read_options
from auv_torchrl.paths import EXAMPLE_LOG
from auv_torchrl.vehicle import Vehicle, load_vehicle

EXAMPLE = "example"  # log=example is the log that comes with the package, unless there is a file of that name
NO_LOG = f"no log: give log=flight.csv, or log={EXAMPLE} for the one that comes with the package"

log = logging.getLogger(__name__)


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
    output: str = MISSING


def register() -> None:
    """Make the schema known to Hydra as ``diagnose_schema``."""
    ConfigStore.instance().store("diagnose_schema", DiagnoseSchema)


@dataclass(frozen=True)
class Request:
    """What to diagnose."""

    vehicle_name: str
    vehicle: Vehicle  # nominal, no batch
    uncertainty: tuple[Coefficient, ...]  # of the vehicle's coefficients
    settings: Settings
    log: FlightLog
    healthy: tuple[FlightLog, ...] = field(default=())
    test: tuple[FlightLog, ...] = field(default=())


def read_request(config: DictConfig) -> Request:
    """Read every file that the config names.

    Raises:
        ValueError: for a vehicle, setting or log that cannot be used, naming it and what to do.
    """
    if OmegaConf.is_missing(config, "log"):
        raise ValueError(NO_LOG)
    vehicle = load_vehicle(_plain(config.vehicle))
    settings = read_settings(_plain(config.diagnosis), vehicle)
    uncertainty = read_uncertainty(_plain(config.vehicle).get("uncertainty"), vehicle)
    extra = _names(config, "extra")
    options = read_options(_names(config, "modes"), _plain(config.params), config.system)
    kinds = {}
    for kind in ("log", "healthy", "test"):
        kinds[kind] = tuple(read_flightlog(_shipped(path), vehicle, extra, options) for path in _names(config, kind))
    if not kinds["log"]:
        raise ValueError(NO_LOG)
    logs = [flight for group in kinds.values() for flight in group]
    report_findings(logs)
    if not config.trust_log:
        _refuse_errors(logs)
    return Request(
        vehicle_name=str(config.vehicle.get("name", "unnamed")),
        vehicle=vehicle,
        uncertainty=uncertainty,
        settings=settings,
        log=join(kinds["log"]),
        healthy=kinds["healthy"],
        test=kinds["test"],
    )


def report_findings(logs: Sequence[FlightLog]) -> None:
    """Say what was read and what was found about it."""
    for flight in logs:
        log.info(
            "%s: %d episodes, %.0f s, %s", flight.name, len(flight.episodes), flight.duration, " ".join(flight.axes)
        )
        for finding in flight.findings:
            log.info("  %s", finding)


def _refuse_errors(logs: Sequence[FlightLog]) -> None:
    errors = [f"{flight.name}: {f}" for flight in logs for f in flight.findings if f.severity is Severity.ERROR]
    if errors:
        raise FlightLogError(f"{'; '.join(errors)} Or give trust_log=true to diagnose it as it is")


def _names(config: DictConfig, key: str) -> tuple[str, ...]:
    value = _plain(config[key])
    if value is None:
        return ()
    return tuple(str(entry) for entry in value) if isinstance(value, list) else (str(value),)


def _shipped(path: str) -> str:
    return str(EXAMPLE_LOG) if path == EXAMPLE and not Path(path).exists() else path


def _plain(config: Any) -> Any:
    return OmegaConf.to_container(config, resolve=True) if OmegaConf.is_config(config) else config
