"""Scenarios: when effects act, how they compose, and that mistakes are named."""

import numpy as np
import pytest

from auv_torchrl.scenario import Scenario, read_scenario
from auv_torchrl.vehicle import load_vehicle

PAPER = load_vehicle("paper")


def read(effects):
    return read_scenario("test", {"effects": effects}, PAPER)


def test_an_empty_scenario_is_the_nominal_vehicle():
    """No effects, no change, no switching."""
    for empty in (
        Scenario("none"),
        read_scenario("none", None, PAPER),
        read_scenario("none", {"effects": None}, PAPER),
    ):
        vehicle = empty.vehicle_at(PAPER, 3.0)
        assert all(np.array_equal(vehicle.get(key), value) for key, value in PAPER.items())
        assert empty.switching_times() == []


def test_effects_act_from_start_to_stop():
    """A change holds while start <= t < stop."""
    scenario = read({"thruster_gain": {"gain_1": 0.5, "start_s": 2.0, "stop_s": 4.0}, "buoyancy": {"force": 3.0}})
    gains = [float(scenario.vehicle_at(PAPER, t).gain[0]) for t in (0.0, 1.99, 2.0, 3.99, 4.0)]
    assert gains == [1.0, 1.0, 0.5, 0.5, 1.0]
    assert float(scenario.vehicle_at(PAPER, 0.0).vertical_force) == 3.0
    assert scenario.switching_times() == [2.0, 4.0]


def test_one_effect_can_act_twice():
    """Labels of one's own let an effect appear more than once, in order."""
    scenario = read(
        {
            "first": {"effect": "thruster_gain", "gain_1": 0.5},
            "second": {"effect": "thruster_gain", "gain": 0.5, "start_s": 1.0},
        }
    )
    assert scenario.vehicle_at(PAPER, 0.0).gain[:2].tolist() == [0.5, 1.0]
    assert scenario.vehicle_at(PAPER, 1.0).gain[:2].tolist() == [0.25, 0.5]


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        ({"gremlin": {}}, "no effect named 'gremlin'"),
        ({"thruster_gain": {"gain": 9.0}}, r"give a number in \[-2, 2\]"),
        ({"thruster_gain": {"size": 1.0}}, "no parameter 'size'"),
        ({"thruster_gain": 1.0}, "give a mapping of parameters"),
        ({"thruster_gain": {"gain": 1.0, "start_s": 3.0, "stop_s": 2.0}}, "give 0 <= start_s < stop_s"),
        ({"thruster_gain": {"gain": 1.0, "start_s": -1.0}}, "give 0 <= start_s < stop_s"),
        ({"thruster_gain": {"gain": 1.0, "start_s": "soon"}}, "give 0 <= start_s < stop_s"),
        ({"x": {"effect": None}}, "no effect named None"),
    ],
)
def test_mistakes_are_named(effects, message):
    """Unknown effects and parameters, impossible values and times are errors that say what to give."""
    with pytest.raises(ValueError, match=message):
        read(effects)


@pytest.mark.parametrize("config", [{"efects": {}}, {"effects": [1, 2]}, {"effects": "swap"}, ["effects"]])
def test_a_foreign_mapping_is_refused(config):
    """A scenario has effects, a mapping, and nothing else."""
    with pytest.raises(ValueError, match="scenario test"):
        read_scenario("test", config, PAPER)
