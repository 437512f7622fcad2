"""A Doppler log that is turned about the vertical, and sits off the origin of the body."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from auv_torchrl.effects.effect import changed
from auv_torchrl.physics import prepare
from auv_torchrl.physics.kinematics import quaternion_from_euler
from auv_torchrl.sensors import MOTION, Inverse, measured_velocity, motion_of, read
from auv_torchrl.vehicle import load_vehicle, read_vehicle_file
from auv_torchrl.vehicle.changed_file import described, entries, fold
from auv_torchrl.vehicle.tensors import tensors

PAPER = load_vehicle("paper")
LOGS = {  # channels, and the velocities of them that are no more than what the instrument says
    "everything": (MOTION, ()),
    "no pose": (MOTION[6:], ("u", "v", "w")),
    "depth and heading": (("z", "yaw", *MOTION[6:]), ("u", "v")),
    "east alone": (("y", "yaw", "u", "v", "r"), ("u",)),
    "surge alone": (("yaw", "u", "r"), ("u",)),
}
logs = pytest.mark.parametrize(("channels", "told"), LOGS.values(), ids=LOGS)
number = st.floats(-1.4, 1.4).map(lambda value: round(value, 3))
motions = st.lists(number, min_size=12, max_size=12)
rates = st.lists(number, min_size=6, max_size=6)


def coefficients(scale=1.0, turn=0.0, position=(0.0, 0.0, 0.0), **fields):
    """Coefficients (1,) of a vehicle with a Doppler log that is mounted so."""
    told = dict(velocity_scale=scale, dvl_turn=turn, dvl_position=position, **fields)
    vehicle = changed(PAPER, **{name: np.array(value, dtype=np.float64) for name, value in told.items()})
    return prepare(vehicle.expand(1)).numpy()


def states(numbers):
    """States (1, 13) of 12 numbers of a motion."""
    motion = np.array(numbers)[None]
    return np.concatenate([motion[:, :3], quaternion_from_euler(*motion[:, 3:6].T), motion[:, 6:]], axis=-1)


mounted = st.builds(
    coefficients,
    scale=st.sampled_from((1.0, 0.8, -1.0, 2.0)),
    turn=st.floats(-math.pi, math.pi) | st.sampled_from((0.0, math.pi / 2, math.pi)),
    position=st.tuples(number, number, number) | st.just((0.0, 0.0, 0.0)),
    heading_bias=st.sampled_from((0.0, 0.4)),
    depth_scale=st.sampled_from((1.0, -1.2)),
)


@logs
@settings(deadline=None, max_examples=60)
@given(c=mounted, numbers=motions)
def test_true_and_reported_states_are_inverses_of_each_other(channels, told, c, numbers):
    """Whatever the log holds, from what is reported to what is true and back nothing is lost, either way round."""
    sensors, state = Inverse.of(c, channels), states(numbers)
    np.testing.assert_allclose(sensors.reported_state(sensors.true_state(state)), state, atol=1e-9)
    np.testing.assert_allclose(sensors.true_state(sensors.reported_state(state)), state, atol=1e-9)


@logs
@settings(deadline=None, max_examples=60)
@given(c=mounted, numbers=motions)
def test_reading_the_true_state_gives_the_reported_one(channels, told, c, numbers):
    """The instrument says of the true motion what the log says of the reported one, where the log has no other word."""
    state = states(numbers)
    report = read(c, told or ("x", "y"), motion_of(Inverse.of(c, channels).true_state(state)))
    shown = {name: value for name, value in zip(MOTION, motion_of(state)[0], strict=True)}
    assert report[0] == pytest.approx([shown[name] for name in told or ("x", "y")], abs=1e-9)


@logs
@settings(deadline=None, max_examples=60)
@given(
    c=mounted,
    numbers=motions,
    rate=st.lists(number, min_size=6, max_size=6),
    by=st.lists(number, min_size=6, max_size=6),
)
def test_accelerations_go_both_ways(channels, told, c, numbers, rate, by):
    """A true acceleration more, and what would be reported of it less: the same, at any motion."""
    sensors, reported = Inverse.of(c, channels), states(numbers)
    true = sensors.true_state(reported)
    one, other = (sensors.reported_rate(np.array([r]), true, reported) for r in (rate, np.add(rate, by)))
    np.testing.assert_allclose(sensors.true_rate(other - one, reported)[0], by, atol=1e-9)


@settings(deadline=None, max_examples=40)
@given(c=mounted, numbers=motions, rate=rates)
def test_reported_accelerations_are_how_reported_velocities_change(c, numbers, rate):
    """Of a vehicle that gains speed as it turns, along the axes of the instrument."""
    sensors, true = Inverse.of(c, MOTION[6:]), states(numbers)
    later = true + 1e-4 * np.concatenate([np.zeros(7), rate])
    gained = (sensors.reported_state(later) - sensors.reported_state(true))[0, 7:] / 1e-4
    found = sensors.reported_rate(np.array([rate]), true, sensors.reported_state(true))
    np.testing.assert_allclose(found[0], gained, atol=1e-7)


def test_a_doppler_log_reports_the_velocity_of_its_place_along_its_axes():
    """A vehicle that goes ahead and turns to starboard, a log 0.5 m forward whose bow points to starboard."""
    c = coefficients(scale=2.0, turn=math.pi / 2, position=(0.5, 0.0, 0.1))
    velocity = np.array([[1.0, 0.0, 0.2, 0.3, 0.0, 0.4]])
    due = np.array([0.5 * 0.4 - 0.3 * 0.1, -1.0, 0.2])  # ahead is to port of it, its bow moves with the turn
    assert measured_velocity(c, velocity)[0, :3] == pytest.approx(2.0 * due)
    on_torch = prepare(
        changed(tensors(PAPER), dvl_turn=torch.tensor(math.pi / 2), dvl_position=torch.tensor([0.5, 0.0, 0.1]))
    )
    assert measured_velocity(on_torch, torch.as_tensor(velocity))[0, :3].numpy() == pytest.approx(due)


def test_a_mounting_is_found_in_the_file_of_a_vehicle_and_written_there():
    """A file that leaves it out is what it was, to the bit and to the hash of what was kept of it."""
    content = {**read_vehicle_file("paper"), "sensors": {"dvl_position": [0.1, 0.0, -0.2], "dvl_turn": 0.785}}
    vehicle = load_vehicle(content)
    assert vehicle.dvl_position.tolist() == [0.1, 0.0, -0.2] and float(vehicle.dvl_turn) == 0.785
    written = entries(fold(vehicle), "mine")["sensors"]
    assert (written["dvl_position"], written["dvl_turn"]) == ([0.1, 0.0, -0.2], 0.785)
    assert {"dvl_position", "dvl_turn"} <= set(described(vehicle))
    for said in (entries(fold(PAPER), "plain")["sensors"], described(PAPER)):
        assert not {"dvl_position", "dvl_turn"} & set(said)
    with pytest.raises(ValueError, match="dvl_position is 0.1: give 3 numbers"):
        load_vehicle({**content, "sensors": {"dvl_position": 0.1}})


def test_a_vehicle_beside_one_that_is_turned_is_inverted_to_the_same_bit():
    """What a candidate with another mounting does to a batch stays with it."""
    plain = coefficients(scale=0.7)
    turned = coefficients(turn=0.3, position=(0.1, 0.2, 0.3))
    both = type(plain)(*(np.concatenate(fields) for fields in zip(plain, turned, strict=True)))
    state, rate = np.repeat(states(np.linspace(-1, 1, 12)), 2, axis=0), np.linspace(0, 1, 12).reshape(2, 6)
    alone, beside = (Inverse.of(c, MOTION[6:]) for c in (plain, both))
    assert (alone.true_state(state[:1]) == beside.true_state(state)[:1]).all()
    assert (alone.reported_state(state[:1]) == beside.reported_state(state)[:1]).all()
    assert (alone.reported_rate(rate[:1], state[:1], state[:1]) == beside.reported_rate(rate, state, state)[:1]).all()
