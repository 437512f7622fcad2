"""A vehicle whose changes are known flies as the source vehicle does."""

from dataclasses import replace

import numpy as np
import pytest
import torch
import yaml
from torchrl.envs import TransformedEnv
from torchrl.envs.utils import check_env_specs

from auv_torchrl.agents.pid import PID
from auv_torchrl.compensation.known_vehicle import KnownVehicle
from auv_torchrl.ddr.transform import observing
from auv_torchrl.envs import make_fleet
from auv_torchrl.evaluation import draw_starts, fly
from auv_torchrl.paths import config_path
from auv_torchrl.scenario import Scenario, read_scenario
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import load_vehicle
from auv_torchrl.vehicle.tensors import tensors

VEHICLE = load_vehicle("paper")
TASK = StationKeeping().for_evaluation(1.0)
TO_THRUSTERS = replace(TASK, thruster_commands=True)


def scenario(name):
    return read_scenario(name, yaml.safe_load(config_path("scenario", name).read_text()), VEHICLE)


def fleet(flown, task, count=4):
    return make_fleet("mujoco", VEHICLE, task, count, scenario=flown, seed=0)


def behind(adapter, env):
    return TransformedEnv(env, observing(adapter, TASK))


def late_errors(env, state="measured"):
    """Mean position and heading error for t >= 10 s, m and rad."""
    flight = fly(env, PID(TASK, state=state), draw_starts(TASK, 4, seed=1), TASK.steps - 1)
    return float(flight.position_error[:, 200:].mean()), float(flight.heading_error[:, 200:].mean())


@pytest.fixture(scope="module")
def healthy():
    return late_errors(fleet(Scenario("nominal"), TASK))


@pytest.mark.parametrize(
    "name",
    [
        "two_reversed",
        "command_delay",
        *(
            pytest.param(name, marks=pytest.mark.thorough)
            for name in ("current", "payload", "pose_delay", "sensor_scales")
        ),
    ],
)
def test_what_is_known_is_undone(name, healthy):
    """Behind the map the changed vehicle holds its target as well as the healthy one, within 5 mm."""
    flown = scenario(name)
    adapter = KnownVehicle(VEHICLE, flown.vehicle_at(VEHICLE), TASK)
    assert late_errors(behind(adapter, fleet(flown, TO_THRUSTERS)), "expected")[0] < healthy[0] + 0.005


def test_propellers_that_turn_the_wrong_way_are_undone_on_exchanged_plugs_too():
    """Of thrusters that push less hard backwards, which a gain of -1 does not say."""
    vehicle = load_vehicle("bluerov2_heavy")
    content = {"effects": {"thruster_swap": {"pair": [1, 2], "reversed": [2, 4]}}}
    flown = read_scenario("wires", content, vehicle)
    healthy = late_errors(make_fleet("mujoco", vehicle, TASK, 4, seed=0))
    adapter = KnownVehicle(vehicle, flown.vehicle_at(vehicle), TASK)
    fleet = make_fleet("mujoco", vehicle, TO_THRUSTERS, 4, scenario=flown, seed=0)
    assert late_errors(behind(adapter, fleet), "expected")[0] < healthy[0] + 0.005


def test_a_known_heading_bias_leaves_no_heading_error(healthy):
    """Without the map the vehicle stands 20 degrees off."""
    flown = scenario("heading_bias")
    adapter = KnownVehicle(VEHICLE, flown.vehicle_at(VEHICLE), TASK)
    assert late_errors(fleet(flown, TASK))[1] > 0.3
    assert late_errors(behind(adapter, fleet(flown, TO_THRUSTERS)), "expected")[1] < healthy[1] + 0.03


def test_the_source_vehicle_itself_gets_the_commands_of_its_mixer():
    """Nothing is known to be different: thrusts are what the mixer gives, up to the regularisation."""
    adapter = KnownVehicle(VEHICLE, VEHICLE, TASK)
    env = TransformedEnv(fleet(Scenario("nominal"), TO_THRUSTERS), adapter)
    env.reset()
    action = 0.3 * torch.tensor([[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1.0]])
    mixed = action @ tensors(VEHICLE).mixer[:, [0, 1, 2, 5]].float().mT
    torch.testing.assert_close(adapter.translate(action), mixed, atol=2e-3, rtol=0)


def test_the_map_keeps_the_contract_of_its_environment():
    """Specs hold, partial resets included."""
    check_env_specs(behind(KnownVehicle(VEHICLE, VEHICLE, TASK), fleet(scenario("command_delay"), TO_THRUSTERS, 2)))


def test_lost_measurements_and_impossible_actions_give_commands_within_limits():
    """Where a measurement is not a number the model's own prediction stands for it."""
    flown = scenario("command_delay")
    adapter = KnownVehicle(VEHICLE, flown.vehicle_at(VEHICLE), TASK)
    env = behind(adapter, fleet(flown, TO_THRUSTERS, 3))
    tensordict = env.reset()
    for step in range(30):
        action = torch.full((3, 4), 0.5)
        if step % 3 == 0:
            action[0] = torch.nan
        tensordict = env.step(tensordict.set("action", action))["next"]
        assert tensordict["applied_action"].isfinite().all() and tensordict["applied_action"].abs().max() <= 1
        lost = tensordict.clone()
        lost["measured", "velocity"][1] = torch.nan
        adapter.learn(np.zeros((3, 6)), tensordict.set("action", tensordict["applied_action"]), lost)
        assert all(values.isfinite().all() for values in lost["expected"].values())
