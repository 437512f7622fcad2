"""Measured states out of messages, and when they were measured."""

import numpy as np
import pytest

from auv_torchrl.fly.mavlink import Message
from auv_torchrl.fly.motion import Clock, Measured, Source

YAW = np.pi / 2  # east


def told(name, system=1, **fields):
    """A message of the vehicle."""
    return Message(name, system, 1, fields)


def attitude(boot_s, **fields):
    """Heading east."""
    usual = dict.fromkeys(("roll", "pitch", "rollspeed", "pitchspeed"), 0.0) | {"yaw": YAW, "yawspeed": 0.1}
    return told("ATTITUDE", time_boot_ms=round(1000 * boot_s), **{**usual, **fields})


def local(boot_s, **fields):
    """North 1, east 2, 3 deep, going east."""
    usual = {"x": 1.0, "y": 2.0, "z": 3.0, "vx": 0.0, "vy": 0.5, "vz": 0.0}
    return told("LOCAL_POSITION_NED", time_boot_ms=round(1000 * boot_s), **{**usual, **fields})


def test_position_and_attitude_make_a_state_along_the_axes_of_the_body():
    """Who heads east and goes east surges."""
    measured = Measured(Source.LOCAL, 1)
    assert measured.take(local(5.0), 100.0) is None  # no attitude yet
    assert measured.take(attitude(5.0), 100.0) is None
    motion = measured.take(local(5.02), 100.02)
    assert motion is not None
    assert motion.time_s == pytest.approx(100.02) and motion.position == (1.0, 2.0, 3.0)
    np.testing.assert_allclose(motion.velocity, (0.5, 0, 0, 0, 0, 0.1), atol=1e-12)
    np.testing.assert_allclose(motion.quaternion, (np.sqrt(0.5), 0, 0, np.sqrt(0.5)))


def test_a_position_without_a_recent_attitude_is_none():
    """Otherwise the vehicle would be steered by a heading that it no longer has."""
    measured = Measured(Source.LOCAL, 1)
    measured.take(attitude(5.0), 100.0)
    assert measured.take(local(5.09), 100.09) is not None
    assert measured.take(local(5.2), 100.2) is None


def test_another_vehicle_is_not_listened_to():
    """Its position would be taken for ours."""
    measured = Measured(Source.LOCAL, 1)
    measured.take(attitude(5.0), 100.0)
    assert measured.take(local(5.0)._replace(system=2), 100.0) is None


def test_odometry_is_taken_in_its_frames_alone():
    """NED and FRD; another frame is none of ours."""
    names = "x y z qw qx qy qz vx vy vz rollspeed pitchspeed yawspeed"
    fields = dict(zip(names.split(), range(13), strict=True))
    measured = Measured(Source.ODOMETRY, 1)
    for frames in ((1, 12), (20, 12), (1, 8), (5, 12)):
        message = told("ODOMETRY", 9, time_usec=5_000_000, frame_id=frames[0], child_frame_id=frames[1], **fields)
        motion = measured.take(message, 100.0)
        assert (motion is not None) == (frames in ((1, 12), (20, 12)))
        assert motion is None or motion[1:] == ((0, 1, 2), (3, 4, 5, 6), (7, 8, 9, 10, 11, 12))


def test_of_a_tracker_the_speed_is_that_of_its_positions():
    """Over 0.2 s; the turning rates are the vehicle's."""
    measured, motion = Measured(Source.VISION, 1), None
    for n in range(20):
        measured.take(attitude(5 + 0.05 * n), 100 + 0.05 * n)
        place = {"x": 0.0, "y": 0.025 * n, "z": 2.0, "roll": 0.0, "pitch": 0.0, "yaw": YAW}
        motion = measured.take(told("VISION_POSITION_ESTIMATE", 9, usec=5e6 + 5e4 * n, **place), 100 + 0.05 * n)
    assert motion is not None
    np.testing.assert_allclose(motion.velocity, (0.5, 0, 0, 0, 0, 0.1), atol=1e-9)


def test_what_was_long_on_its_way_was_measured_then():
    """The fastest message tells how the clocks differ."""
    clock = Clock()
    assert clock.ours(100.0, 5.0) == 100.0
    assert clock.ours(100.9, 5.5) == pytest.approx(100.5, abs=1e-3)
    assert clock.ours(101.1, 6.2) == 101.1  # faster than the first one
    assert clock.ours(101.5, 6.4) == pytest.approx(101.3, abs=1e-3)


def test_a_clock_that_steps_back_is_that_of_an_autopilot_that_was_started_anew():
    """A message that overtook another is not."""
    measured = Measured(Source.LOCAL, 1)
    measured.take(attitude(500.0), 100.0)
    measured.take(attitude(499.9), 100.1)
    assert not measured.restarted
    measured.take(attitude(2.0), 100.2)
    assert measured.restarted
