"""From a composed config to the logs and the vehicle that a diagnosis needs, checked."""

import filecmp
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from auv_torchrl.diagnosis.calibrate.kept import Kept, read_kept
from auv_torchrl.diagnosis.calibrate.uncertainty import Coefficient, read_uncertainty
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.logs import KINDS, find_logs, names
from auv_torchrl.diagnosis.settings import read_settings
from auv_torchrl.flightlog import FlightLog, FlightLogError, Severity, join, read_flightlog
from auv_torchrl.flightlog.streams.options import read_options
from auv_torchrl.vehicle import Vehicle, load_vehicle

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Request:
    """What to diagnose."""

    vehicle_name: str
    vehicle: Vehicle  # nominal, no batch
    uncertainty: tuple[Coefficient, ...]  # of the vehicle's coefficients
    settings: Settings
    logs: tuple[FlightLog, ...]
    kept: Kept | None = None  # what the vehicle's file keeps of healthy logs
    healthy: tuple[FlightLog, ...] = ()
    test: tuple[FlightLog, ...] = ()

    @cached_property
    def log(self) -> FlightLog:
        """All of them as one, joined once."""
        return join(self.logs)

    @property
    def said(self) -> frozenset[str]:
        """What the findings say that were printed when the logs were read, by themselves and in the joined log."""
        told = ((flight.name, finding.sentence) for flight in self.logs for finding in flight.findings)
        return frozenset(sentence for name, said in told for sentence in (said, f"{name}: {said}"))


def read_request(config: DictConfig) -> Request:
    """Read every file that the config names.

    Raises:
        ValueError: for a vehicle, setting or log that cannot be used, naming it and what to do.
    """
    paths = find_logs(config)
    refuse_copies(paths)
    content = plain_config(config.vehicle)
    vehicle = load_vehicle(content)
    settings = read_settings(plain_config(config.diagnosis), vehicle)
    uncertainty = read_uncertainty(content.get("uncertainty"), vehicle)
    kept = read_kept(content.get("calibration"), uncertainty)
    extra = names(config, "extra")
    options = read_options(names(config, "modes"), plain_config(config.params), config.system)
    kinds = {kind: tuple(read_flightlog(path, vehicle, extra, options) for path in paths[kind]) for kind in KINDS}
    logs = [flight for group in kinds.values() for flight in group]
    report_findings(logs)
    if not config.trust_log:
        refuse_errors(logs)
    return Request(
        vehicle_name=str(config.vehicle.get("name", "unnamed")),
        vehicle=vehicle,
        uncertainty=uncertainty,
        settings=settings,
        logs=kinds["log"],
        kept=kept,
        healthy=kinds["healthy"],
        test=kinds["test"],
    )


def refuse_copies(paths: Mapping[str, Sequence[Path]]) -> None:
    """Refuse a healthy log, or one to test on, that is the log to explain.

    Raises:
        FlightLogError: naming both.
    """
    for kind, what in (("healthy", "a flight from before the fault"), ("test", "another flight")):
        for other, path in product(paths[kind], paths["log"]):
            same = other.samefile(path)
            if same or (other.is_file() and path.is_file() and filecmp.cmp(other, path, shallow=False)):
                how = "the log to explain itself" if same else f"a copy of {path.name}, the log to explain"
                raise FlightLogError(f"{kind}={other.name} is {how}: give {what}, or leave it out")


def report_findings(logs: Sequence[FlightLog]) -> None:
    """Say what was read and what was found about it."""
    for flight in logs:
        log.info(
            "%s: %d episodes, %.0f s, %s", flight.name, len(flight.episodes), flight.duration, " ".join(flight.axes)
        )
        for finding in flight.findings:
            log.info("  %s", finding)


def refuse_errors(logs: Sequence[FlightLog]) -> None:
    """Refuse logs of which the check says that they cannot be what they should.

    Raises:
        FlightLogError: naming log and error.
    """
    errors = [f"{flight.name}: {f}" for flight in logs for f in flight.findings if f.severity is Severity.ERROR]
    if errors:
        raise FlightLogError(f"{'; '.join(errors)} Or give trust_log=true to diagnose it as it is")


def plain_config(config: Any) -> Any:
    """A part of a config as lists and mappings."""
    return OmegaConf.to_container(config, resolve=True) if OmegaConf.is_config(config) else config
