"""A torpedo with fins: depth and heading at speed, and what fins that are stuck or reversed do to them."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from torchrl.envs import TransformedEnv
from torchrl.envs.utils import check_env_specs

from auv_torchrl.authority import Recovery, authority, check_control
from auv_torchrl.ddr import AdapterConfig, adapt, pretrain
from auv_torchrl.envs import TorchFleet
from auv_torchrl.evaluation import Metrics, draw_starts, fly
from auv_torchrl.paths import config_path
from auv_torchrl.scenario import Scenario, read_scenario
from auv_torchrl.tasks import Cruise
from auv_torchrl.vehicle import load_vehicle
from auv_torchrl.yaml_file import read_yaml
from tests.helmsmen import helmsman_of_torpedo

REMUS = load_vehicle("remus100")
TASK = Cruise(episode_s=30.0).fitted(REMUS)
EXAM = TASK.for_evaluation(1.0)
AXES = ("surge", "pitch", "yaw")
EXPERIMENT = read_yaml(config_path("experiment", "cruise"), "experiment")


def fault(name):
    """A scenario of the package, for the torpedo."""
    return read_scenario(name, read_yaml(config_path("scenario", name), "scenario"), REMUS)


def flown(scenario, around=lambda fleet: fleet, count=8):
    """How the helmsman does."""
    starts = draw_starts(EXAM, count, 7)
    return Metrics.of(
        fly(around(TorchFleet(REMUS, EXAM, count, scenario, seed=0)), helmsman_of_torpedo(TASK), starts, EXAM.steps)
    )


def test_a_torpedo_is_commanded_in_surge_pitch_and_yaw():
    """As its mixer says, and the specs of the environment hold."""
    fleet = TorchFleet(REMUS, Cruise(), 2, seed=0)
    assert fleet.task.axes == AXES and fleet.action_spec.shape == (2, 3)
    check_env_specs(fleet)


def test_fins_have_authority_at_speed_alone():
    """At rest a torpedo turns no way; at 1.5 m/s a stuck fin leaves all axes, two of them none of yaw."""
    check_control(REMUS, "cruise", AXES, by_channels=True, speed=1.5)
    with pytest.raises(ValueError, match="task cruise also needs pitch and yaw"):
        check_control(REMUS, "cruise", AXES, by_channels=True)
    stuck = fault("fin_stuck").vehicle_at(REMUS)
    assert authority(stuck, REMUS, "stuck", AXES, 1.5).recovery is Recovery.CHANNELS
    both = stuck.replace(gain=stuck.gain * [1, 0, 0, 1, 1])
    assert authority(both, REMUS, "both", AXES, 1.5).lost == ("yaw",)


def test_a_helmsman_keeps_depth_and_heading_until_a_fin_fails():
    """Within 0.3 m and 3 degrees at 1.5 m/s; with reversed rudders, or one that is stuck, not the heading."""
    limit = math.radians(3.0)
    healthy = flown(Scenario("nominal"))
    assert healthy.mean_m < 0.3 and healthy.heading_rad < limit
    for name in ("fin_reversed", "fin_stuck"):
        assert flown(fault(name)).heading_rad > 2 * limit


@pytest.mark.thorough
@pytest.mark.slow
def test_reversed_rudders_are_adapted_to():
    """Eight seconds of flight give the map behind which the helmsman keeps depth and heading again."""
    scenario, limit = fault("fin_reversed"), math.radians(3.0)
    config = AdapterConfig(**EXPERIMENT["adapter"])
    target = partial(TorchFleet, REMUS, EXAM, scenario=scenario, seed=1)
    found = adapt(target, helmsman_of_torpedo(TASK), pretrain(REMUS, TASK), config)
    mended = flown(scenario, lambda fleet: TransformedEnv(fleet, found.adapter))
    assert mended.mean_m < 0.3 and mended.heading_rad < limit
    yaw = AXES.index("yaw")
    assert found.adapter.maps[0].unlimited[yaw, yaw] < -0.5


def test_a_map_of_few_axes_is_fitted_to_all_that_was_flown():
    """By the rule for bags two axes would keep 18 pairs, in which a dither of 0.2 s turns hardly four times."""
    config = AdapterConfig(**EXPERIMENT["adapter"])
    assert config.bag_least * TASK.control_dt >= config.target_data_s


def test_the_depth_that_is_rewarded_is_the_one_to_come():
    """A vehicle that sinks back to its depth with the time constant loses nothing by it; one that stays there does."""
    task = replace(TASK, heading_weight=0.0, speed_weight=0.0, turning_weight=0.0, action_weight=0.0)
    level = np.array([1.0, 0.0, 0.0, 0.0])
    deep, far = np.array([0.0, 0.0, 0.02]), np.array([0.0, 0.0, 50.0])

    def lost(position, rising):
        velocity = np.array([1.5, 0.0, -rising, 0.0, 0.0, 0.0])
        return -float(task.reward(position, level, velocity, np.zeros(3), np.zeros(())))

    assert lost(deep, 0.0) == pytest.approx(0.02, rel=1e-3)
    assert lost(deep, 0.01) == pytest.approx(0.0, abs=1e-5)
    steepest = 1.5 * math.sin(task.steepest)
    assert lost(far, steepest) == pytest.approx(0.0, abs=1e-9) and lost(far, 0.0) == pytest.approx(2 * steepest)
    now = replace(task, ahead_s=0.0)
    assert -float(now.reward(far, level, np.zeros(6), np.zeros(3), np.zeros(()))) == 50.0
