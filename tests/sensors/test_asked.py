"""Which vehicles report alike is told by the coefficients that their sensors ask for."""

import numpy as np
import pytest

from auv_torchrl.diagnosis.identify.hypotheses import batch
from auv_torchrl.physics import Coefficients, prepare
from auv_torchrl.sensors import FELT, MOTION, ages, read, report_otherwise, report_the_same
from auv_torchrl.sensors.asked import coefficients_asked
from auv_torchrl.vehicle import load_vehicle

VEHICLE = load_vehicle("bluerov2")
ROWS = [
    {},
    {"thruster_gain": {"gain_1": 0.3}},
    {"depth_scale": {"factor": 1.1}},
    {"depth_scale": {"factor": 1.1}, "thruster_gain": {"gain_1": 0.3}},
    {"heading_bias": {"angle": 0.2}},
    {"pose_delay": {"delay": 0.1}},
]


def prepared(rows) -> Coefficients:
    """Coefficients of vehicles with these effects."""
    return prepare(batch(VEHICLE, rows)).numpy()


def test_vehicles_with_the_same_sensors_report_the_same():
    """A weak thruster changes no report of a motion; a scale, a bias or a delay of a sensor does."""
    before, after = prepared([{}]), prepared(ROWS)
    first, kind = report_the_same(before, after, MOTION)
    assert kind.tolist() == [-1, -1, 0, 0, 1, 2]
    assert first.tolist() == [2, 4, 5]
    motion = np.random.default_rng(0).normal(size=(len(ROWS), 12))
    motion[:] = motion[0]
    for name, reports in (("read", read(after, MOTION, motion)), ("ages", ages(after, MOTION))):
        for one, other in ((0, 1), (2, 3)):
            np.testing.assert_array_equal(reports[one], reports[other], err_msg=name)


@pytest.mark.parametrize("channels", [MOTION, ("z", "yaw", *FELT)])
def test_thrusters_count_where_they_turn_the_compass(channels):
    """What thrusters give is asked for by a compass that they turn, and by no other sensor."""
    assert "gain" not in coefficients_asked(prepared([{}]), channels)
    turned = prepared([{"compass_interference": {"angle": 0.3}}])
    assert {"gain", "full_thrust"} <= set(coefficients_asked(turned, channels))


def test_a_sensor_that_a_log_lacks_changes_no_report_of_it():
    """Of one true motion, a log of the heading alone shows its bias and its delay, and no scale of a depth."""
    before, after = prepared([{}]), prepared(ROWS)
    assert report_otherwise(before, after, ("yaw",)).tolist() == [False, False, False, False, True, True]
    assert report_otherwise(before, after, ("z", "r")).tolist() == [False, False, True, True, False, True]
