"""How fast the estimates of a filter go astray, as a log tells."""

import numpy as np
import pytest

from auv_torchrl.flightlog.streams.drift import ANGLE_DRIFT, POSITION_DRIFT, drift_of
from auv_torchrl.flightlog.streams.stream import Sampling, Stream, stream


def made(name, channels, unit, t, values, sampling=Sampling.ESTIMATED, drift=None) -> Stream:
    """A stream that is there."""
    found = stream(name, channels, unit, t, values, sampling, "made up", drift)
    assert found is not None
    return found


def turning(rate: np.ndarray, t: np.ndarray, sampling: Sampling = Sampling.ESTIMATED):
    """A yaw (T,) with this rate (T,), roll and pitch level."""
    yaw = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(t))])
    angles = np.stack([0 * t, 0 * t, np.arctan2(np.sin(yaw), np.cos(yaw))], -1)
    return made("attitude", ("roll", "pitch", "yaw"), "rad", t, angles, sampling)


def felt(rate: np.ndarray, t: np.ndarray):
    """A gyro about the vertical."""
    return made("gyro", "pqr", "rad/s", t, np.stack([0 * t, 0 * t, rate], -1), Sampling.MEASURED)


@pytest.mark.parametrize("size", [0.001, 0.01])
def test_an_attitude_goes_astray_by_what_its_gyro_did_not_feel(size):
    """A yaw that turns otherwise than the gyro by a slow random rate is said to do so, within a factor of two."""
    rng = np.random.default_rng(0)
    t = np.arange(0, 200, 0.1)
    true = 0.5 * np.sin(t / 3)
    off = np.repeat(rng.normal(scale=size, size=len(t) // 40), 40)  # lasts for 4 s
    assert size / 2 < drift_of(turning(true + off, t), felt(true, t)) < 2 * size


def test_a_sensor_does_not_go_astray():
    """What was measured has noise on every sample, and is not held against the gyro."""
    t = np.arange(0, 100, 0.1)
    assert drift_of(turning(0.3 + 0 * t, t, Sampling.MEASURED), felt(0 * t, t)) == 0.0


def test_what_is_not_said_is_what_filters_usually_do():
    """Without a gyro, and for positions whose source tells nothing; what it tells goes first."""
    t = np.arange(0, 100, 0.1)
    place = np.stack([t, 0 * t, 0 * t], -1)
    assert drift_of(turning(0 * t, t), None) == ANGLE_DRIFT
    assert drift_of(made("position", "xyz", "m", t, place), None) == POSITION_DRIFT
    told = made("position", "xyz", "m", t, place, drift=0.2)
    assert drift_of(told, None) == 0.2


def test_a_gyro_that_was_hardly_there_tells_nothing():
    """Ten seconds in common are too few to tell a rate that lasts for two."""
    t = np.arange(0, 100, 0.1)
    few = t[t < 10]
    assert drift_of(turning(0 * t, t), felt(0 * few, few)) == ANGLE_DRIFT


def test_one_sample_of_an_attitude_tells_nothing():
    """It has no interval; what filters usually do is taken."""
    t = np.arange(0, 20, 0.1)
    assert drift_of(turning(np.zeros(1), t[:1]), felt(0 * t, t)) == ANGLE_DRIFT
