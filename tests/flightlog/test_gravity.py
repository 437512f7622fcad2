"""Units and frames of an accelerometer: what it logs is converted, kept or left out, and never read as a force."""

from dataclasses import replace

import numpy as np
import pytest

from auv_torchrl.flightlog import FlightLogError, read_flightlog, write_flightlog
from auv_torchrl.flightlog.log import join
from auv_torchrl.vehicle import load_vehicle
from tests.flightlog.simulate import simulated_logs

FELT = ("ax", "ay", "az")
PAPER = load_vehicle("paper")


@pytest.fixture(scope="module")
def log():
    """A sound log with everything measured, an accelerometer too."""
    return simulated_logs("paper", [{}], felt=0.02)[0]


def reread(log, tmp_path, change=lambda felt: felt, axes=None):
    """The log written with changed accelerations, and read again."""
    episodes = tuple(replace(e, acceleration=change(e.acceleration)) for e in log.episodes)
    written = replace(log, episodes=episodes, axes=axes or log.axes)
    return read_flightlog(write_flightlog(written, tmp_path / "log.csv"), PAPER)


def test_accelerations_are_read_as_they_were_written(log, tmp_path):
    """Columns ax, ay, az in m/s^2 along forward, right, down give no finding, and come back to the last digit."""
    found = reread(log, tmp_path)
    assert found.axes == log.axes and found.axes[-3:] == FELT and not found.findings
    for then, now in zip(log.episodes, found.episodes, strict=True):
        assert now.acceleration is not None and then.acceleration is not None
        np.testing.assert_allclose(now.acceleration, then.acceleration, atol=1e-6)


@pytest.mark.parametrize(("unit", "factor"), [("g", 9.81), ("mg", 9.81e-3), ("feet per second squared", 0.3048)])
def test_other_units_are_converted_and_named(log, tmp_path, unit, factor):
    """A weight of 1, 1000 or 32 tells the unit, and a warning says what was done."""
    found = reread(log, tmp_path, lambda felt: felt / factor)
    (finding,) = (f for f in found.findings if f.code == "acceleration_unit")
    assert f"in {unit} " in finding.sentence and finding.columns == FELT
    now, then = found.episodes[0].acceleration, log.episodes[0].acceleration
    assert now is not None and then is not None
    np.testing.assert_allclose(now, then, atol=2e-5)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (lambda felt: felt * [1, -1, -1], "upwards"),
        (lambda felt: -felt, "upwards"),
        (lambda felt: -felt / 9.81, "upwards"),
        (lambda felt: felt + [0, 0, 9.81], "no weight"),
        (lambda felt: felt[:, [2, 1, 0]], "elsewhere"),
        (lambda felt: felt * 1.8, "elsewhere"),
    ],
    ids=["z up", "signs", "signs in g", "weight taken out", "axes exchanged", "scaled"],
)
def test_a_weight_that_is_not_where_it_belongs_leaves_the_sensor_out(log, tmp_path, change, word):
    """Frames that cannot be told apart are not guessed: the axes are left out, and a warning says how to log them."""
    found = reread(log, tmp_path, change)
    (finding,) = (f for f in found.findings if f.code == "acceleration_frame")
    assert word in finding.sentence and "az is about -9.8" in finding.remedy
    assert not set(FELT) & set(found.axes) and found.episodes[0].acceleration is None


def test_without_its_vertical_axis_it_is_left_out(log, tmp_path):
    """Nothing tells the unit and the frame of ax and ay alone."""
    found = reread(log, tmp_path, axes=tuple(axis for axis in log.axes if axis != "az"))
    assert "acceleration_frame" in {f.code for f in found.findings} and "ax" not in found.axes


def test_an_accelerometer_alone_measures_no_motion(log, tmp_path):
    """Without anything else a log is refused, and what is missing is named."""
    with pytest.raises(FlightLogError, match="measures nothing"):
        reread(log, tmp_path, axes=FELT)


def test_joined_logs_have_it_where_both_do(log):
    """Of two logs of which one has none, it is left out, and a finding says so."""
    without = replace(log, axes=log.axes[:-3], episodes=tuple(replace(e, acceleration=None) for e in log.episodes))
    both, one = join([log, log]), join([log, without])
    assert both.axes == log.axes and both.episodes[-1].acceleration is not None
    assert one.axes == without.axes and one.episodes[0].acceleration is None
    assert one.findings[-1].sentence == "left out because not every log measures them: ax, ay, az"
