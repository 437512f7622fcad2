"""From a composed config to the logs, the vehicle and the settings that a diagnosis needs, checked."""

import filecmp
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Annotated, Any

from omegaconf import DictConfig, OmegaConf

from auv_torchrl.diagnosis.calibrate.parameters import Coefficient, read_uncertainty
from auv_torchrl.diagnosis.calibrate.vehicle_file import StoredCalibration, read_calibration
from auv_torchrl.diagnosis.command.logs import KINDS, find_logs, names
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.effects import EFFECTS
from auv_torchrl.effects.effect import Parameter
from auv_torchrl.effects.trial import Scan
from auv_torchrl.flightlog import Finding, FlightLog, FlightLogError, Severity, join, read_flightlog
from auv_torchrl.flightlog.readiness import refuse_errors
from auv_torchrl.flightlog.streams.options import read_options
from auv_torchrl.quantities import counted
from auv_torchrl.settings import In, check, choices, settings_of
from auv_torchrl.vehicle import Vehicle, load_vehicle, vehicle_doubts


@dataclass(frozen=True)
class NuisanceEntry:
    """What ``diagnosis.nuisance`` says of one parameter of an effect."""

    deviation: Annotated[float, In("(0, 10]")]  # relative; 0 would be a parameter that is exact: leave it out


def read_settings(content: Mapping[str, Any], vehicle: Vehicle) -> Settings:
    """Settings from a mapping like ``conf/diagnosis/default.yaml``.

    Args:
        content: every field of :class:`Settings`.
        vehicle: nominal, empty batch; it says which parameters an effect has.

    Raises:
        ValueError: for a missing, unknown or impossible entry, naming it and what to give.
    """
    settings = settings_of(Settings, content, "diagnosis")
    if 2 * settings.bin_s > settings.window_s:
        raise ValueError(
            f"diagnosis.bin_s is {settings.bin_s}: give half of diagnosis.window_s, {settings.window_s}, or less"
        )
    for key in ("ignored", "thresholds"):
        for name in getattr(settings, key) or ():
            _effect(name, f"diagnosis.{key}")
    for name, deviations in _mapping(settings.nuisance, "diagnosis.nuisance").items():
        for parameter, deviation in _mapping(deviations, f"diagnosis.nuisance.{name}").items():
            where = f"diagnosis.nuisance.{name}.{parameter}"
            _parameter(name, parameter, where)
            check(NuisanceEntry, {"deviation": deviation}, where)
    for name, scan in _mapping(settings.scan, "diagnosis.scan").items():
        _check_scan(name, _mapping(scan, f"diagnosis.scan.{name}"), vehicle)
    return settings


def _check_scan(name: str, scan: Mapping[str, Any], vehicle: Vehicle) -> None:
    where = f"diagnosis.scan.{name}"
    declared = _effect(name, where).member_parameters(vehicle)
    if "together" in scan:
        rows = scan["together"]
        if set(scan) != {"together"} or not isinstance(rows, list | tuple) or not rows:
            raise ValueError(f"{where} is {dict(scan)!r}: give together alone, with a list of parameters and values")
        for row in rows:
            for member, value in _mapping(row, f"{where}.together").items():
                if member not in declared:
                    raise ValueError(f"{where}.together: no parameter {member!r}: {choices([member], declared)}")
                _check_value(value, declared[member], f"{where}.together {member}")
        return
    for parameter, entry in scan.items():
        p, key = _parameter(name, parameter, where), f"{where}.{parameter}"
        known = [field.name for field in fields(Scan)]
        if odd := set(_mapping(entry, key)) - set(known):
            raise ValueError(f"{key}: unknown keys {sorted(odd)}: {choices(odd, known)}")
        if "values" not in entry:
            raise ValueError(f"{key} has no values: give {key}.values")
        check(Scan, entry, key)
        for value in entry["values"]:
            if not entry.get("relative", False):
                _check_value(value, p, f"{key}.values")


def _check_value(value: Any, p: Parameter, where: str) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not p.low <= value <= p.high:
        raise ValueError(f"{where} has {value!r}: give numbers in [{p.low:g}, {p.high:g}] {p.unit}")


def _mapping(content: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(content, Mapping):
        raise ValueError(f"{where} is {content!r}: give a mapping")
    return content


def _effect(name: str, where: str) -> Any:
    if name not in EFFECTS:
        raise ValueError(f"{where}: no effect named {name!r}: {choices([name], EFFECTS)}")
    return EFFECTS[name]


def _parameter(effect: str, name: str, where: str) -> Parameter:
    continuous = {p.name: p for p in _effect(effect, where).parameters if not p.discrete}
    if name not in continuous:
        raise ValueError(f"{where}: no parameter {name!r}: {choices([name], continuous)}")
    return continuous[name]


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
    def printed(self) -> frozenset[str]:
        """What the findings say that were printed when the logs were read, by themselves and in the joined log."""
        sentences = ((flight.name, finding.sentence) for flight in self.logs for finding in flight.findings)
        return frozenset(one for name, sentence in sentences for one in (sentence, f"{name}: {sentence}"))


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
