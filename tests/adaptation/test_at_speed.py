"""The adaptation in flight of vehicles that steer by turning: a torpedo with fins, a surface vessel."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from torchrl.envs import TransformedEnv

from auv_torchrl.adaptation import InFlightAdapter, load_adaptation_config
from auv_torchrl.adaptation.filter import EffectivenessFilter
from auv_torchrl.adaptation.motion import SourceMotion, motion_of
from auv_torchrl.ddr.transform import observing
from auv_torchrl.envs import TorchFleet
from auv_torchrl.evaluation import draw_starts, fly
from auv_torchrl.paths import config_path
from auv_torchrl.physics import ActiveTerms, control_step, prepare, rest_state
from auv_torchrl.physics.kinematics import quaternion_from_euler
from auv_torchrl.physics.pushes import steady_thrust
from auv_torchrl.scenario import Scenario, read_scenario
from auv_torchrl.tasks import Cruise
from auv_torchrl.vehicle import load_vehicle
from auv_torchrl.vehicle.tensors import tensors
from auv_torchrl.yaml_file import read_yaml
from tests.helmsmen import helmsman_of_torpedo, helmsman_of_vessel

REMUS, OTTER, FERRY = load_vehicle("remus100"), load_vehicle("otter"), load_vehicle("milliampere")
AT_S, LENGTH_S, COUNT = 6.0, 20.0, 3


def test_one_step_is_that_of_the_plain_physics():
    """A torpedo that slips, turns and tilts, with all fins deflected: velocities agree within a few per cent."""
    motion, vehicle, count = SourceMotion(REMUS, 0.05, ("surge", "pitch", "yaw"), 1.5), tensors(REMUS), 20
    rng = np.random.default_rng(0)
    velocity = rng.uniform(-0.1, 0.1, (count, 6)) + [1.5, 0, 0, 0, 0, 0]
    command = rng.uniform(-0.8, 0.8, (count, vehicle.thrusters))
    c = prepare(vehicle.expand(count).clone())
    quaternion = quaternion_from_euler(*torch.from_numpy(rng.uniform(-0.2, 0.2, (3, count))))
    state = rest_state(torch.zeros(count, 3).double(), quaternion, torch.from_numpy(velocity), vehicle.thrusters)
    after = control_step(c, ActiveTerms.of(c), state, torch.from_numpy(command))
    told = command.copy()
    told[:, 0] = np.abs(told[:, 0]) * told[:, 0]  # thrust goes by the square of the shaft speed
    mean, end = motion.turning(np.zeros_like(told), told)
    np.testing.assert_allclose(end[:, 1:], (after.thrust / c.full_thrust).numpy()[:, 1:], atol=1e-9)
    body = np.concatenate((np.zeros((count, 3)), quaternion.numpy()), axis=-1)
    step = motion(velocity, (mean * motion.flow(velocity, mean)) @ motion.per_share.T, body)
    moved = np.abs(after.velocity.numpy() - velocity).max(0)
    assert (np.abs(step.velocity - after.velocity.numpy()).max(0) < 0.06 * moved).all()


def flown(vehicle, name, acting):
    """Flights of a helmsman with the adaptation, in which something acts from 6 s on, and the adapter."""
    task = replace(Cruise(episode_s=LENGTH_S).fitted(vehicle).for_evaluation(0.3), start_heading=0.2)
    task = replace(task, thruster_commands=True)
    adapter = InFlightAdapter(vehicle, task, load_adaptation_config(), COUNT)
    fleet = TorchFleet(vehicle, task, COUNT, acting, seed=0)
    env = TransformedEnv(fleet, observing(adapter, task))
    vessel = helmsman_of_vessel(1.5, 8.0) if name == "milliampere" else helmsman_of_vessel()
    pilot = helmsman_of_torpedo(task) if name == "remus100" else vessel
    return fly(env, pilot, draw_starts(task, COUNT, 7), task.steps), adapter


def task_axes(name):
    """That follow from the mixers of the vehicles."""
    return ("surge", "pitch", "yaw") if name == "remus100" else ("surge", "yaw")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "fault"),
    [
        ("remus100", "fin_stuck"),
        pytest.param("otter", "swap", marks=pytest.mark.thorough),
        pytest.param("milliampere", "azimuth_offset", marks=pytest.mark.thorough),
        pytest.param("milliampere", None, marks=pytest.mark.thorough),
        pytest.param("remus100", "fin_reversed", marks=pytest.mark.thorough),
        pytest.param("remus100", None, marks=pytest.mark.thorough),
    ],
)
def test_a_fault_in_flight_is_noticed_and_the_course_is_kept(name, fault):
    """No alarm without a fault, one soon after it, and less than 3 degrees of heading error from 10 s later on."""
    vehicle = load_vehicle(name)
    read = read_yaml(config_path("scenario", fault), "scenario") if fault else None
    changes = read_scenario(str(fault), read, vehicle).changes
    flight, adapter = flown(vehicle, name, Scenario("acting", tuple(replace(c, start_s=AT_S) for c in changes)))
    late = flight.time[0] >= AT_S + 10.0
    assert float(flight.heading_error[:, late].mean()) < math.radians(3.0)
    assert float(flight.position_error[:, late].mean()) < 0.3
    alarms = adapter.learner.alarms
    assert (alarms > 0).all() if fault else (alarms == 0).all()
    remaining = adapter.authority(0)
    assert remaining.axes == task_axes(name) and remaining.thruster_rank == len(remaining.axes)


def test_what_is_reported_is_along_the_axes_of_an_action():
    """Three of a torpedo with five actuators, at the speed of the task; what vessels have pushes along two."""
    for vehicle, shape in ((REMUS, (3, 5)), (OTTER, (2, 2)), (FERRY, (2, 4))):
        task = replace(Cruise().fitted(vehicle), thruster_commands=True)
        adapter = InFlightAdapter(vehicle, task, load_adaptation_config(), 2)
        env = TransformedEnv(TorchFleet(vehicle, task, 2, seed=0), observing(adapter, task))
        found = env.reset()["effectiveness"]
        assert found.shape == (2, *shape) and env.action_spec.shape == (2, shape[0])
        motion = motion_of(vehicle, task)
        np.testing.assert_allclose(found[0].numpy(), motion.per_share[motion.controlled], rtol=1e-6, atol=1e-6)


def test_fins_push_with_the_square_of_the_speed():
    """A propeller pushes the same at each."""
    motion = SourceMotion(REMUS, 0.05, ("surge", "pitch", "yaw"), 1.5)
    speeds = np.array([[1.5, 0, 0, 0, 0, 0], [0.75, 0, 0, 0, 0, 0], [-1.0, 0, 0, 0, 0, 0]])
    flow = motion.flow(speeds, np.zeros((3, 5)))
    np.testing.assert_allclose(flow, [[1, 1, 1, 1, 1], [1, 0.25, 0.25, 0.25, 0.25], [1, 0, 0, 0, 0]], atol=1e-9)


def test_a_rudder_against_a_turn_stalls():
    """In a turn to starboard the hull slips to port: full rudder to port adds less than to starboard."""
    motion = SourceMotion(REMUS, 0.05, ("surge", "pitch", "yaw"), 1.5)
    turn = np.array([[1.3, -0.2, 0, 0, 0, 0.27]])
    on, against = (motion.flow(turn, np.full((1, 5), share))[0, 1] for share in (-1.0, 1.0))
    assert 0.0 < against < 0.8 * on


def test_servos_push_with_the_thrust_that_they_turn():
    """1 at the thrust that keeps up the speed, half with half of it, the other way where it pushes backwards."""
    motion = SourceMotion(FERRY, 0.05, ("surge", "yaw"), 1.5)
    steady = steady_thrust(prepare(FERRY), ActiveTerms.of(prepare(FERRY)), np.array(1.5)) / FERRY.full_thrust
    shares = np.array([steady, [steady[0] / 2, -steady[1], 1.0, 1.0]])
    np.testing.assert_allclose(motion.flow(np.zeros((2, 6)), shares), [[1, 1, 1, 1], [1, 1, 0.5, -1]])


def test_poses_alone_are_refused_at_speed():
    """The sentence says what to give."""
    task = replace(Cruise().fitted(REMUS), thruster_commands=True)
    config = load_adaptation_config(overrides={"sensed": "pose"})
    with pytest.raises(ValueError, match="velocities are needed: give adaptation.sensed=velocity"):
        InFlightAdapter(REMUS, task, config, 1)


def test_what_a_stuck_fin_pushes_is_known_to_go_with_the_speed():
    """The wrench without commands has a part that grows with the flow, and one that a payload stands for."""
    motion = SourceMotion(REMUS, 0.05, ("surge", "pitch", "yaw"), 1.5)
    slow = np.array([[0.75, 0, 0, 0, 0, 0]])
    np.testing.assert_allclose(motion.steady(slow), [[1.0, 0.25]], atol=1e-3)
    kalman = EffectivenessFilter(motion, load_adaptation_config())
    belief = kalman.start(1)
    belief.mean[:, kalman.velocity] = slow
    belief.mean[:, kalman.constant] = np.repeat([1.0, 4.0], 6)
    np.testing.assert_allclose(kalman.map_of(belief)[1], np.full((1, 6), 2.0), atol=1e-2)
    assert SourceMotion(OTTER, 0.05, ("surge", "yaw"), 1.5).steady(slow).shape == (1, 1)
