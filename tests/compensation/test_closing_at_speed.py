"""A diagnosis is put into controllers of vehicles that steer by turning: with fins, azimuth thrusters or propellers."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from torchrl.envs import TransformedEnv

from auv_torchrl.compensation.excitation import Excitation
from auv_torchrl.compensation.known_vehicle import KnownVehicle
from auv_torchrl.compensation.target_log import cruising, fly_target_log
from auv_torchrl.ddr.transform import observing
from auv_torchrl.envs import TorchFleet
from auv_torchrl.evaluation import Metrics, draw_starts, fly
from auv_torchrl.scenario import Scenario, read_scenario
from auv_torchrl.tasks import Cruise, StationKeeping
from auv_torchrl.vehicle import load_vehicle
from auv_torchrl.vehicle.tensors import tensors
from tests.helmsmen import helmsman_of_torpedo, helmsman_of_vessel

REMUS, OTTER, FERRY = load_vehicle("remus100"), load_vehicle("otter"), load_vehicle("milliampere")
COUNT = 2
HEALTHY = Scenario("healthy")


def task_of(vehicle):
    """Up to half a radian off course."""
    return replace(Cruise(episode_s=11.0).fitted(vehicle).for_evaluation(0.3), start_heading=0.5)


def flown(vehicle, scenario, known=None):
    """How a helmsman holds his course, behind the map of a known vehicle where there is one."""
    task = task_of(vehicle)
    fleet = TorchFleet(vehicle, replace(task, thruster_commands=known is not None), COUNT, scenario, seed=0)
    env = fleet if known is None else TransformedEnv(fleet, observing(KnownVehicle(vehicle, known, task), task))
    vessel = helmsman_of_vessel(1.5, 8.0) if vehicle.servos else helmsman_of_vessel()
    pilot = helmsman_of_torpedo(task) if "pitch" in task.axes else vessel
    return Metrics.of(fly(env, pilot, draw_starts(task, COUNT, 1), task.steps))


@pytest.mark.parametrize(
    ("vehicle", "effects"),
    [
        (REMUS, {"fin_gain": {"gain_2": -1.0, "gain_3": -1.0}, "current": {"north": 0.2, "east": 0.3}}),
        pytest.param(FERRY, {"azimuth_gain": {"gain_3": -1.0, "gain_4": -1.0}}, marks=pytest.mark.thorough),
        pytest.param(OTTER, {"thruster_swap": {"pair": [1, 2]}}, marks=pytest.mark.thorough),
    ],
)
def test_what_is_known_is_undone(vehicle, effects):
    """Without the map they turn away; behind it they are within 2 cm, or 1 degree, of the healthy ones."""
    scenario = read_scenario("told", {"effects": effects}, vehicle)
    healthy, broken = flown(vehicle, HEALTHY), flown(vehicle, scenario)
    mapped = flown(vehicle, scenario, scenario.vehicle_at(vehicle))
    assert broken.heading_rad > 0.5
    assert mapped.heading_rad < healthy.heading_rad + math.radians(1.0)
    assert mapped.mean_m < healthy.mean_m + 0.02


def test_the_source_vehicle_gets_what_its_mixer_says():
    """Nothing is known to be different: each channel by itself moves the fins as the mixer does, within a hundredth."""
    task = replace(task_of(REMUS), thruster_commands=True)
    adapter = KnownVehicle(REMUS, REMUS, task)
    TransformedEnv(TorchFleet(REMUS, task, 3, HEALTHY, seed=0), adapter).reset()
    action = torch.tensor([[0.5, 0, 0], [0.5, 0.15, 0], [0.5, 0, -0.15]])
    mixed = action @ tensors(REMUS).mixer[:, [0, 4, 5]].float().mT
    torch.testing.assert_close(adapter.translate(action), mixed, atol=1e-2, rtol=0)


def test_the_stick_moves_about_what_keeps_the_speed():
    """A vessel that is left at those channels stays at 1.5 m/s; one that hovers is moved about none."""
    task = replace(task_of(OTTER), speed_spread=0.0)
    middle = cruising(OTTER, task)
    fleet = TorchFleet(OTTER, task, 1, HEALTHY, seed=0)
    state = fleet.reset()
    for _ in range(60):
        state = fleet.step(state.set("action", middle[None]))["next"]
    assert float(state["velocity"][0, 0]) == pytest.approx(1.5, abs=0.03)
    assert not cruising(load_vehicle("paper"), StationKeeping()).any()


def test_a_vehicle_at_speed_logs_its_pose_and_its_velocity():
    """All twelve numbers, of each flight, along the way that they say."""
    make = lambda task, count: TorchFleet(REMUS, task, count, HEALTHY, seed=0)  # noqa: E731
    log = fly_target_log(make, REMUS, task_of(REMUS), Excitation(2, 5.0), "target")
    assert len(log.axes) == 12 and len(log.episodes) == 2
    one = log.episodes[0]
    assert np.isfinite(one.pose).all() and np.isfinite(one.velocity).all()
    assert np.linalg.norm(np.diff(one.pose[::20, :3], axis=0), axis=-1).mean() == pytest.approx(
        np.linalg.norm(one.velocity[:, :3], axis=-1).mean(), rel=0.1
    )
