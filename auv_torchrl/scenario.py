"""A scenario: which effects act on the vehicle, with which values, from when to when."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from auv_torchrl.effects import Effect, get_effect
from auv_torchrl.effects.effect import PartAbsent
from auv_torchrl.paths import config_names, config_path
from auv_torchrl.vehicle import Vehicle
from auv_torchrl.yaml_file import read_yaml


@dataclass(frozen=True)
class Change:
    """One effect with values that holds while ``start_s <= t < stop_s``."""

    label: str
    effect: Effect
    values: dict[str, float]
    start_s: float = 0.0
    stop_s: float = math.inf


@dataclass(frozen=True)
class Scenario:
    """Changes in the order in which they are applied; an empty scenario is the nominal vehicle."""

    name: str
    changes: tuple[Change, ...] = ()

    def vehicle_at(self, nominal: Vehicle, time_s: float = 0.0) -> Vehicle:
        """The vehicle with every change that holds at ``time_s``."""
        vehicle = nominal
        for change in self.changes:
            if change.start_s <= time_s < change.stop_s:
                vehicle = change.effect.apply(vehicle, change.values)
        return vehicle

    def switching_times(self) -> list[float]:
        """Times above 0 at which the vehicle changes, in order."""
        times = {t for change in self.changes for t in (change.start_s, change.stop_s)}
        return sorted(t for t in times if 0.0 < t < math.inf)


def read_scenario(name: str, config: Mapping[str, Any] | None, vehicle: Vehicle) -> Scenario:
    """Read ``effects: {label: {effect: name, parameter: value, start_s: 0, stop_s: null}}``.

    The label is the effect's name unless ``effect`` says otherwise, so that one effect can act twice.

    Raises:
        ValueError: for an unknown key, effect or parameter, or a value outside its bounds.
    """
    if not isinstance(config, Mapping | None):
        raise ValueError(f"scenario {name} is {config!r}: give a mapping with 'effects'")
    config = dict(config or {})
    effects = config.pop("effects", None) or {}
    if not isinstance(effects, Mapping):
        raise ValueError(f"scenario {name}: effects is {effects!r}: give a mapping of effects to their parameters")
    if config:
        raise ValueError(f"scenario {name}: unknown keys {sorted(map(str, config))}: there is only 'effects'")
    return Scenario(name, tuple(_read_change(name, label, settings, vehicle) for label, settings in effects.items()))


def scenarios_of(vehicle: Vehicle) -> list[str]:
    """Names in ``conf/scenario`` of what can happen to a vehicle: every effect acts on parts that it has.

    Raises:
        ValueError: for a file that cannot be read.
    """
    return [name for name in config_names("scenario") if _can_happen(name, vehicle)]


def _can_happen(name: str, vehicle: Vehicle) -> bool:
    try:
        changes = read_scenario(name, read_yaml(config_path("scenario", name), "scenario"), vehicle).changes
    except PartAbsent:
        return False
    return all(_acts(change, vehicle) for change in changes)  # an effect of thrusters leaves fins as they are


def _acts(change: Change, vehicle: Vehicle) -> bool:
    after = change.effect.apply(vehicle, change.values)
    return any(not np.array_equal(after.get(name), value) for name, value in vehicle.items())


def _read_change(name: str, label: str, settings: Mapping[str, Any] | None, vehicle: Vehicle) -> Change:
    if not isinstance(settings, Mapping):
        raise ValueError(f"scenario {name}: {label} is {settings!r}: give a mapping of parameters to values")
    settings = dict(settings)
    effect = get_effect(settings.pop("effect", label))
    start = settings.pop("start_s", 0.0)
    stop = settings.pop("stop_s", None)
    stop = math.inf if stop is None else stop
    if not all(isinstance(t, int | float) and not isinstance(t, bool) for t in (start, stop)) or not 0 <= start < stop:
        raise ValueError(f"scenario {name}: {label} acts from {start!r} to {stop!r}: give 0 <= start_s < stop_s")
    return Change(label, effect, effect.read(vehicle, settings), float(start), float(stop))
