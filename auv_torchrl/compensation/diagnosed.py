"""What a diagnosis found, as a vehicle to fly and as vehicles to train on."""

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from auv_torchrl.diagnosis.scenario_file import ranges_of, scenario_of
from auv_torchrl.diagnosis.verdict import Diagnosis, FoundEffect, from_json
from auv_torchrl.effects import get_effect
from auv_torchrl.quantities import counted
from auv_torchrl.scenario import Scenario, read_scenario
from auv_torchrl.vehicle import Vehicle

MOST_BYTES = 10_000_000  # a hundred times what a diagnosis of an hour takes
ROUNDING = 1e-6  # relative: the fit stops at a bound to within this


@dataclass(frozen=True)
class Diagnosed:
    """What is believed about a vehicle, and the diagnosis that says so."""

    nominal: Vehicle  # no batch
    scenario: Scenario  # the effects found, with their values, from the start
    ranges: Mapping[str, Any]  # their 95 % intervals, as in conf/randomization
    diagnosis: Diagnosis | None = None  # None where the vehicle is known otherwise

    @classmethod
    def of(cls, diagnosis: Diagnosis, nominal: Vehicle) -> "Diagnosed":
        """The effects of a diagnosis, checked against their bounds.

        Raises:
            ValueError: for an effect or parameter that this vehicle does not have.
        """
        scenario = read_scenario("diagnosed", scenario_of(diagnosis, nominal), nominal)
        return cls(nominal, scenario, ranges_of(diagnosis, nominal), diagnosis)

    @property
    def found(self) -> bool:
        """Whether there is anything to put into the simulator."""
        return bool(self.scenario.changes)

    @property
    def vehicle(self) -> Vehicle:
        """The nominal vehicle with the effects found."""
        return self.scenario.vehicle_at(self.nominal)

    @property
    def switched(self) -> Vehicle:
        """The nominal vehicle with those effects alone that have no range: the base of what is randomized."""
        discrete = []
        for change in self.scenario.changes:
            ranged = self.ranges.get(change.effect.name, {})
            values = {name: value for name, value in change.values.items() if name not in ranged}
            if values:
                discrete.append(replace(change, values=values))
        return replace(self.scenario, changes=tuple(discrete)).vehicle_at(self.nominal)


def read_diagnosed(path: Path, nominal: Vehicle, vehicle_name: str) -> Diagnosed:
    """Read the ``diagnosis.json`` that diagnose.py wrote.

    Raises:
        FileNotFoundError: if it is not there.
        ValueError: if it is no diagnosis, one of another vehicle, or says what an effect cannot be.
    """
    if not path.is_file():
        raise FileNotFoundError(f"no diagnosis {path}: give the diagnosis.json that diagnose.py wrote")
    try:
        diagnosis = from_json(_read_json(path))
    except KeyError as error:
        raise _no_diagnosis(path, f"{error} is missing or unknown in it") from error
    except (OSError, ValueError, TypeError, AttributeError, RecursionError) as error:
        raise _no_diagnosis(path, str(error) or type(error).__name__) from error
    if diagnosis.vehicle != vehicle_name:
        raise ValueError(
            f"{path} is about vehicle {diagnosis.vehicle!r}, this run is about {vehicle_name!r}: "
            f"give vehicle={diagnosis.vehicle}"
        )
    try:
        for found in diagnosis.effects:
            _check_effect(found, nominal)
        return Diagnosed.of(diagnosis, nominal)
    except ValueError as error:
        raise ValueError(f"{path}: {error}: give the diagnosis.json as diagnose.py wrote it") from error


def _no_diagnosis(path: Path, cause: str) -> ValueError:
    return ValueError(f"{path} is no diagnosis ({cause}): give the diagnosis.json that diagnose.py wrote")


def _read_json(path: Path) -> Mapping[str, Any]:
    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is no number of JSON")

    if (size := path.stat().st_size) > MOST_BYTES:
        raise ValueError(f"{counted(size, 'byte')}, a diagnosis has {MOST_BYTES:,} at most")
    content = json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse, object_pairs_hook=_once)
    if not isinstance(content, Mapping):
        raise ValueError("it is no mapping")
    return content


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    if repeated := [name for name, times in Counter(name for name, _ in pairs).items() if times > 1]:
        raise ValueError(f"{repeated[0]!r} is given twice")
    return dict(pairs)


def _check_effect(found: FoundEffect, nominal: Vehicle) -> None:
    """Refuse an effect, parameter or value that this vehicle cannot have: what is written is not bent to fit."""
    declared = get_effect(found.name).member_parameters(nominal)
    if not 0.0 <= found.probability <= 1.0:
        raise ValueError(f"the probability of {found.name} is {found.probability:g}, not in [0, 1]")
    if odd := [number for number in found.thrusters if not 1 <= number <= nominal.thrusters]:
        raise ValueError(f"{found.name} names thruster {odd[0]}, the vehicle has {nominal.thrusters}")
    for name, estimate in found.parameters.items():
        if name not in declared:
            raise ValueError(f"effect {found.name}: no parameter {name!r}: there are {', '.join(declared)}")
        p, spare = declared[name], ROUNDING * max(1.0, abs(estimate.value))
        if not p.low - spare <= estimate.value <= p.high + spare:
            raise ValueError(f"{name} of {found.name} is {estimate.value:g}, not in [{p.low:g}, {p.high:g}]")
        if not estimate.low - spare <= estimate.value <= estimate.high + spare:
            low, high = estimate.low, estimate.high
            raise ValueError(f"{name} of {found.name} is {estimate.value:g}, outside its interval [{low:g}, {high:g}]")
