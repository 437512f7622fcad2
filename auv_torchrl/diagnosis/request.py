"""From a composed config to the logs and the vehicle that a diagnosis needs, checked."""

import filecmp
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from auv_torchrl.diagnosis.calibrate.parameters import Coefficient, read_uncertainty
from auv_torchrl.diagnosis.calibrate.vehicle_file import StoredCalibration, read_calibration
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.logs import KINDS, find_logs, names
from auv_torchrl.diagnosis.settings import read_settings
from auv_torchrl.flightlog import Finding, FlightLog, FlightLogError, Severity, join, read_flightlog
from auv_torchrl.flightlog.readiness import refuse_errors
from auv_torchrl.flightlog.streams.options import read_options
from auv_torchrl.quantities import counted
from auv_torchrl.vehicle import Vehicle, load_vehicle, vehicle_doubts

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Request:
    """What to diagnose."""

    vehicle_name: str
    vehicle: Vehicle  # nominal, no batch
    uncertainty: tuple[Coefficient, ...]  # of the vehicle's coefficients
    settings: Settings
    logs: tuple[FlightLog, ...]
    kept: StoredCalibration | None = None  # what the vehicle's file keeps of healthy logs
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
    kept = read_calibration(content.get("calibration"), uncertainty)
    extra = names(config, "extra")
    options = read_options(names(config, "modes"), plain_config(config.params), config.system, config.mapping)
    kinds = {kind: tuple(read_flightlog(path, vehicle, extra, options) for path in paths[kind]) for kind in KINDS}
    logs = [flight for group in kinds.values() for flight in group]
    report_findings(logs)
    if not config.trust_log:
        refuse_errors(logs)
    first, *others = kinds[
        "log"
    ]  # the warnings that the vehicle's file left when it was loaded stand in the report, too
    kinds["log"] = (replace(first, findings=(*first.findings, *vehicle_findings(vehicle))), *others)
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


def vehicle_findings(vehicle: Vehicle) -> tuple[Finding, ...]:
    """What is implausible about the numbers of a vehicle's file."""
    return tuple(
        Finding(Severity.WARNING, "vehicle_numbers", f"in the vehicle's file {d}") for d in vehicle_doubts(vehicle)
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
            "%s: %s, %.0f s, %s",
            flight.name,
            counted(len(flight.episodes), "episode"),
            flight.duration,
            " ".join(flight.axes),
        )
        for finding in flight.findings:
            log.info("  %s", finding)


def plain_config(config: Any) -> Any:
    """A part of a config as lists and mappings."""
    return OmegaConf.to_container(config, resolve=True) if OmegaConf.is_config(config) else config
