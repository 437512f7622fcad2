"""Settings of a diagnosis from a mapping like ``conf/diagnosis/default.yaml``, checked before anything is simulated."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Annotated, Any

from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.effects import EFFECTS
from auv_torchrl.effects.effect import Parameter
from auv_torchrl.effects.trial import Scan
from auv_torchrl.settings import In, check, choices, settings_of
from auv_torchrl.vehicle import Vehicle


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
