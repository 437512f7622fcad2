"""The scenario files, over the whole folder and the whole registry of effects."""

import numpy as np
import pytest
import yaml

from auv_torchrl.effects import EFFECTS
from auv_torchrl.paths import config_names, config_path
from auv_torchrl.scenario import read_scenario, scenarios_of
from auv_torchrl.vehicle import load_vehicle
from tests.hovering import HOVERING, SERVO_EFFECTS, one_for

PAPER = load_vehicle("paper")


def scenario(name, vehicle):
    return read_scenario(name, yaml.safe_load(config_path("scenario", name).read_text()), vehicle)


def test_every_effect_acts_in_some_scenario():
    """No effect of the registry is left without a scenario file that uses it."""
    used = {
        change.effect.name
        for name in config_names("scenario")
        for change in scenario(name, load_vehicle(suited(name)[0])).changes
    }
    assert used == set(EFFECTS)


def test_a_vehicle_meets_the_scenarios_of_parts_that_it_has():
    """A hovering one all but those of servos, others those of theirs, a vessel of two propellers none of a third."""
    everything = set(config_names("scenario"))
    own = {name: set(scenarios_of(load_vehicle(name))) for name in ("paper", "remus100", "otter", "milliampere")}
    used = {change.effect.name for name in own["paper"] for change in scenario(name, PAPER).changes}
    of_fins, of_azimuths = (
        {f"{kind}_{fault}" for fault in ("offset", "reversed", "stuck")} for kind in ("fin", "azimuth")
    )
    assert not SERVO_EFFECTS & used and everything - own["paper"] == of_fins | of_azimuths
    assert of_fins < own["remus100"] and not of_azimuths & own["remus100"] and "thruster_gain" not in own["remus100"]
    assert of_azimuths < own["milliampere"] and not of_fins & own["milliampere"]
    assert "swap" in own["otter"] and "cycle" not in own["otter"]


def suited(name):
    """Vehicles that a scenario is for: those with servos of the kind that it is of, or those that hover."""
    effects = SERVO_EFFECTS & set(yaml.safe_load(config_path("scenario", name).read_text())["effects"])
    return sorted({one_for(effect, "paper") for effect in effects}) or HOVERING


@pytest.mark.parametrize(
    ("name", "vehicle_name"), [(name, vehicle) for name in config_names("scenario") for vehicle in suited(name)]
)
def test_every_scenario_changes_every_vehicle_within_bounds(name, vehicle_name):
    """Each file can be read for each vehicle, changes it at some time, and says in a comment what it stands for."""
    vehicle = load_vehicle(vehicle_name)
    read = scenario(name, vehicle)
    times = [0.0, *read.switching_times()]
    changed = [
        not np.array_equal(read.vehicle_at(vehicle, t).get(key), value) for t in times for key, value in vehicle.items()
    ]
    coriolis_is_on_already = name == "coriolis" and float(vehicle.coriolis) == 1.0
    assert any(changed) or coriolis_is_on_already
    assert config_path("scenario", name).read_text().startswith("# ")
