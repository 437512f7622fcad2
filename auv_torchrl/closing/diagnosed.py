"""What a diagnosis found, as a vehicle to fly and as vehicles to train on."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from auv_torchrl.diagnosis.scenario_file import randomization_yaml, scenario_yaml
from auv_torchrl.diagnosis.verdict import Diagnosis
from auv_torchrl.scenario import Scenario, read_scenario
from auv_torchrl.vehicle import Vehicle


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
        scenario = read_scenario("diagnosed", yaml.safe_load(scenario_yaml(diagnosis, nominal)), nominal)
        return cls(nominal, scenario, yaml.safe_load(randomization_yaml(diagnosis, nominal)) or {}, diagnosis)

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
        ValueError: if it is no diagnosis, or one of another vehicle.
    """
    if not path.is_file():
        raise FileNotFoundError(f"no diagnosis {path}: give the diagnosis.json that diagnose.py wrote")
    try:
        diagnosis = Diagnosis.from_json(json.loads(path.read_text(encoding="utf-8")))
    except (json.JSONDecodeError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(
            f"{path} is no diagnosis ({error!r}): give the diagnosis.json that diagnose.py wrote"
        ) from error
    if diagnosis.vehicle != vehicle_name:
        raise ValueError(
            f"{path} is about vehicle {diagnosis.vehicle!r}, this run is about {vehicle_name!r}: "
            f"give vehicle={diagnosis.vehicle}"
        )
    return Diagnosed.of(diagnosis, nominal)
