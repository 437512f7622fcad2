"""Holding a depth and a heading at speed, by vehicles with fewer axes than four."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from torchrl.envs import TransformedEnv
from torchrl.envs.utils import check_env_specs

from auv_torchrl.authority import Recovery, authority
from auv_torchrl.ddr import DDRAdapter, adapt, pretrain
from auv_torchrl.effects import get_effect
from auv_torchrl.envs import TorchFleet, make_fleet
from auv_torchrl.evaluation import Metrics, draw_starts, fly
from auv_torchrl.physics.kinematics import quaternion_from_euler
from auv_torchrl.scenario import Scenario, read_scenario
from auv_torchrl.tasks import Cruise, fitted, read_task
from auv_torchrl.vehicle import load_vehicle
from tests.helmsmen import helmsman_of_vessel

OTTER = load_vehicle("otter")
EXAM = Cruise(episode_s=14.0).for_evaluation(1.0)
SWAP = read_scenario("swap", {"effects": {"thruster_swap": {"pair": [1, 2]}}}, OTTER)


@pytest.mark.parametrize(
    ("vehicle", "axes"),
    [
        ("otter", ("surge", "yaw")),
        ("milliampere", ("surge", "yaw")),
        ("paper", ("surge", "heave", "yaw")),
        ("bluerov2_heavy", ("surge", "heave", "yaw")),
    ],
)
def test_the_axes_follow_from_the_mixer_of_the_vehicle(vehicle, axes):
    """The action has an entry for each, and the observation has depth where the vehicle dives."""
    fleet = TorchFleet(load_vehicle(vehicle), Cruise(), 2, seed=0)
    assert fleet.task.axes == axes
    assert fleet.action_spec.shape == (2, len(axes))
    assert ("far_z" in fleet.task.observation_names) == ("heave" in axes)
    check_env_specs(fleet)


def test_axes_that_are_given_are_kept():
    """Whatever else the mixer has a column for."""
    task = read_task({"name": "cruise", "controlled": ["surge", "yaw"]})
    assert fitted(task, load_vehicle("bluerov2")).axes == ("surge", "yaw")
    with pytest.raises(ValueError, match="task.controlled is .*'sideways'.*: give"):
        Cruise(controlled=("sideways",))


def test_a_vehicle_without_the_axes_is_refused():
    """Two propellers that both push ahead from the middle cannot turn it."""
    weak = OTTER.replace(thruster_position=OTTER.thruster_position * np.array([1.0, 0.0, 1.0]))
    with pytest.raises(ValueError, match="task cruise also needs yaw"):
        TorchFleet(weak, Cruise(), 1)


def test_a_surface_vessel_floats_where_its_file_says():
    """At rest it stays at depth 0, within a millimetre, on both backends."""
    for backend in ("torch", "mujoco"):
        fleet = make_fleet(backend, OTTER, EXAM, 1, seed=0)
        level = torch.tensor([[1.0, 0.0, 0.0, 0.0]])
        start = {"position": torch.zeros(1, 3), "quaternion": level, "velocity": torch.zeros(1, 6)}
        state = fleet.reset(fleet.reset().set("start", fleet.reset()["start"].update(start)), set_state=True)
        for _ in range(100):
            state = fleet.step(state.set("action", torch.zeros(1, 2)))["next"]
        assert state["position"].abs().max() < 1e-3


def test_only_depth_and_heading_are_errors():
    """A place far north and east is no miss; 0.2 m of depth and 0.1 rad of heading are 0.3 m."""
    task = Cruise()
    level = np.array([quaternion_from_euler(*np.zeros(3)), quaternion_from_euler(0.0, 0.0, np.array(0.1))])
    position, velocity = np.array([[50.0, 20.0, 0.0], [0.0, 0.0, 0.2]]), np.array([[1.5, 0, 0, 0, 0, 0]] * 2)
    time = np.array([0.0, 3.0])
    np.testing.assert_allclose(task.miss(position, level, velocity, time), [0.0, 0.3], atol=1e-9)
    np.testing.assert_allclose(task.reference(time).nearest(position)[1], [0.0, 0.0, 0.0])


def test_a_turn_is_wanted_at_a_rate_that_ends_with_the_error():
    """Far off who turns at the rate loses nothing, faster or slower does; near by the rate falls with the error."""
    slow = Cruise(turn_rate=0.1, depth_weight=0.0, speed_weight=0.0, turning_weight=0.0, action_weight=0.0)

    def lost(heading, rate, task=slow):
        quaternion = quaternion_from_euler(*np.array([0.0, 0.0, heading]))
        velocity = np.array([1.5, 0.0, 0.0, 0.0, 0.0, rate])
        return -float(task.reward(np.zeros(3), quaternion, velocity, np.zeros(3), np.zeros(())))

    assert lost(1.0, -0.1) == pytest.approx(0.0, abs=1e-4)
    assert lost(1.0, -0.3) == pytest.approx(slow.turn_s * 0.2, abs=1e-4)
    assert lost(-1.0, 0.0) == pytest.approx(slow.turn_s * 0.1, abs=1e-4)
    assert lost(0.01, -0.01 / slow.turn_s) == pytest.approx(0.0, abs=1e-5)
    assert lost(2 * math.pi + 0.01, 0.0) == pytest.approx(0.01, rel=1e-2)
    at_will = replace(slow, turn_rate=None)  # whatever the rate, the heading counts
    assert lost(1.0, -0.3, at_will) == lost(1.0, 0.0, at_will) == pytest.approx(1.0)


def test_the_error_of_the_turning_is_seen_in_rates_of_a_turn():
    """A vehicle that is to turn to port and goes straight on is off by one; one that turns so, by nothing."""
    task = Cruise(turn_rate=0.1).fitted(OTTER)
    east = quaternion_from_euler(*np.array([0.0, 0.0, math.pi / 2]))

    def seen(rate):
        velocity = np.array([1.5, 0.0, 0.0, 0.0, 0.0, rate])
        observed = task.observe(np.zeros(3), east, velocity, np.zeros(()))
        return dict(zip(task.observation_names, observed, strict=True))["turning_error"]

    assert seen(0.0) == pytest.approx(1.0, abs=1e-3)
    assert seen(-0.1) == pytest.approx(0.0, abs=1e-3)


def test_starts_are_under_way_within_what_is_asked_for():
    """Depth, heading and speed; a vessel that does not dive starts at the surface."""
    position, quaternion, velocity = Cruise().draw_starts(500, torch.Generator().manual_seed(0))
    assert position[:, 2].abs().max() <= 4.0 and (position[:, :2] == 0).all()
    assert ((velocity[:, 0] - 1.5).abs() <= 0.45 + 1e-9).all()
    assert quaternion.norm(dim=-1).allclose(torch.ones(500).double())
    afloat = Cruise().fitted(OTTER).draw_starts(50, torch.Generator().manual_seed(0))[0]
    assert (afloat == 0).all()


def test_authority_is_that_of_the_axes():
    """A surface vessel has rank 2; exchanged plugs can be mapped, with one dead propeller surge and yaw go together."""
    axes = ("surge", "yaw")
    swapped = authority(SWAP.vehicle_at(OTTER), OTTER, "swap", axes)
    assert swapped.recovery is Recovery.CHANNELS and "2 of 2 degrees of freedom" in str(swapped)
    dead = authority(get_effect("thruster_gain").apply(OTTER, {"gain_1": 0.0}), OTTER, "dead", axes)
    assert dead.recovery is Recovery.NONE and dead.coupled == axes


@pytest.mark.thorough
def test_a_surface_vessel_with_exchanged_plugs_is_adapted_to():
    """A helmsman that holds 3 degrees turns in circles with exchanged plugs, and holds them again behind the map."""
    policy, starts = helmsman_of_vessel(), draw_starts(EXAM, 8, 7)

    def flown(scenario, around=lambda fleet: fleet):
        return Metrics.of(fly(around(TorchFleet(OTTER, EXAM, 8, scenario, seed=0)), policy, starts, EXAM.steps))

    limit = math.radians(3.0)
    assert flown(Scenario("nominal")).heading_rad < limit
    assert flown(SWAP).heading_rad > 10 * limit
    models = pretrain(OTTER, EXAM.fitted(OTTER))
    found = adapt(lambda count: TorchFleet(OTTER, EXAM, count, SWAP, seed=1), policy, models)
    assert isinstance(found.adapter, DDRAdapter) and found.adapter.channels == 2
    assert flown(SWAP, lambda fleet: TransformedEnv(fleet, found.adapter)).heading_rad < limit
