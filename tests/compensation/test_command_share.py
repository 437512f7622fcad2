"""What a map of the commands can undo is told from a flight alone."""

import pytest

from auv_torchrl.agents.pid import PID
from auv_torchrl.compensation.command_share import command_sentence, command_share
from auv_torchrl.envs import TorchFleet
from auv_torchrl.evaluation import draw_starts, fly
from auv_torchrl.scenario import read_scenario
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import load_vehicle

VEHICLE = load_vehicle("paper")
TASK = StationKeeping(episode_s=5.0).for_evaluation(1.0)


def share(effects):
    scenario = read_scenario("some", {"effects": effects}, VEHICLE)
    fleet = TorchFleet(VEHICLE, TASK, 6, scenario=scenario, seed=0)
    return command_share(fly(fleet, PID(TASK), draw_starts(TASK, 6, seed=1), TASK.steps), VEHICLE, TASK.control_dt)


@pytest.mark.parametrize(
    ("effects", "low", "high"),
    [
        ({"thruster_swap": {"cycle": [1, 2, 3]}}, 0.95, 1.0),
        ({"thruster_gain": {"gain_1": -1.0}}, 0.95, 1.0),
        ({"buoyancy": {"force": 8.0}}, 0.95, 1.0),  # a constant is a part of an affine map
        ({"command_delay": {"delay": 0.3}}, 0.0, 0.8),
        ({"quadratic_drag": {"scale": 2.0}}, 0.0, 0.9),
    ],
)
def test_faults_of_thrusters_are_maps_of_commands_and_delay_and_drag_are_not(effects, low, high):
    """The share is nearly 1 for what a map undoes, clearly less for the rest, and the sentence names the remedy."""
    found = share(effects)
    assert found is not None and low <= found <= high
    assert ("diagnose=true" in command_sentence(found)) == (found <= 0.9)


@pytest.mark.parametrize("effects", [{}, {"heading_bias": {"angle": 0.4}}])
def test_what_sensors_report_is_no_matter_of_commands(effects):
    """The motion is the nominal one: there is nothing for a map of the commands."""
    assert share(effects) is None
    assert "no map of the commands" in command_sentence(None)
