"""Logs that measure little, and the noise of what they measure."""

from dataclasses import replace

import numpy as np
import pytest
from flown_logs import fly, hold

from auv_torchrl.diagnosis import Verdict, diagnose
from auv_torchrl.diagnosis.axes import examined, followable, restricted, steep_stretches, unseen
from auv_torchrl.diagnosis.conclude.findings import noise_finding
from auv_torchrl.diagnosis.identify.following import follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.effects.effect import changed
from auv_torchrl.flightlog import FlightLogError, Severity
from auv_torchrl.vehicle import load_vehicle
from tests.flightlog.simulate import simulated_logs

HELD = hold(load_vehicle("paper"))
SETTINGS = load_settings()


@pytest.fixture(scope="module")
def log():
    """A sound vehicle, pose alone."""
    return fly(HELD, {}, seed=1, episodes=2, seconds=10.0)


def problem_of(log, vehicle=HELD):
    """A problem for a log."""
    return Problem.of(cut_windows(log, SETTINGS.window_s, SETTINGS.lead_s, SETTINGS.bin_s), vehicle, SETTINGS)


@pytest.mark.parametrize("axes", [("x", "y"), ("x", "y", "z"), ("x", "z", "yaw"), ("y", "yaw"), ("x", "w", "r")])
def test_positions_without_their_heading_are_left_out(log, axes):
    """X and y are used together with yaw or not at all; nothing left is an error that names what to log."""
    given = replace(log, axes=axes)
    if not set(axes) - {"x", "y"}:
        with pytest.raises(FlightLogError, match="yaw"):
            followable(given)
        return
    left = followable(given)
    assert set(left.axes) == set(axes) - {"x", "y"}
    assert np.isnan(left.episodes[0].pose[:, :2]).all()
    assert left.findings[-1].columns == tuple(axis for axis in ("x", "y") if axis in axes)


def test_a_full_pose_is_kept(log):
    """Nothing is left out of x, y, z, yaw."""
    assert followable(log) is log
    assert unseen(problem_of(log)) == []


def test_unseen_degrees_of_freedom_are_named_with_their_thrusters(log):
    """Without depth heave is unseen, and with it the vertical thrusters; the remedy names the column."""
    assert examined(problem_of(log)) == ()
    problem = problem_of(restricted(log, ("x", "y", "yaw")))
    assert examined(problem) == ("surge", "sway", "yaw")
    (sentence,) = unseen(problem)
    for words in ("heave is not measured", "thrusters 5, 6 do", "z or w"):
        assert words in sentence


def test_logs_without_a_common_axis_are_refused(log):
    """A test log that measures none of the axes of the log is an error that names both."""
    with pytest.raises(FlightLogError, match="x, y, z, yaw"):
        restricted(log, ("u", "v"))


def test_the_noise_of_the_sensors_is_measured(log):
    """2 mm and 0.004 rad are measured, and a vehicle that states less noise gets a warning."""
    problem, _ = follow_windows(problem_of(log))
    finding = noise_finding(problem)
    assert finding.severity is Severity.INFO
    assert problem.sigma["x"] == pytest.approx(0.002, rel=0.15)
    assert problem.sigma["yaw"] == pytest.approx(0.004, rel=0.15)
    assert "sensor_noise: {position: 0.002" in finding.remedy
    problem = replace(problem, vehicle=changed(HELD, position_noise=HELD.position_noise + 0.0005))
    assert noise_finding(problem).severity is Severity.WARNING


def test_thrusters_that_only_turn_the_vehicle_are_named():
    """Of attitude, rates and depth alone, what the horizontal thrusters push is not seen, only how they turn."""
    heavy = load_vehicle("bluerov2_heavy")
    stock = ("z", "roll", "pitch", "yaw", "p", "q", "r")
    log = fly(heavy, {}, seed=1, episodes=1, seconds=8.0, axes=stock)
    (sentence,) = unseen(problem_of(log, heavy))
    assert "surge, sway are not measured" in sentence
    assert "thrusters 1, 2, 3, 4 show by turning the vehicle alone" in sentence


def test_a_vehicle_that_turns_over_is_followed_where_it_is_upright(log):
    """Roll and yaw do not count near straight up or down, all else does, and a finding says so."""
    assert steep_stretches(log) == ()
    first, last = log.episodes
    steep = [replace(e, pose=e.pose.copy()) for e in (first, last)]
    for episode in steep:
        episode.pose[:, 4] = 1.4
    some = replace(log, axes=(*log.axes, "pitch"), episodes=(_level(first), steep[1]))
    windows = cut_windows(some, SETTINGS.window_s, SETTINGS.lead_s, SETTINGS.bin_s)
    assert set(windows.number) == {first.number, last.number}
    turned = dict(zip(windows.channels, np.moveaxis(windows.trust, -1, 0), strict=True))
    over = windows.number == last.number
    assert not turned["yaw"][over].any() and turned["yaw"][~over].any() and turned["pitch"][over].any()
    (finding,) = steep_stretches(some)
    assert "50\u202f% of the samples" in finding.sentence
    whole = replace(some, episodes=tuple(steep))
    assert set(cut_windows(whole, SETTINGS.window_s, SETTINGS.lead_s).number) == {first.number, last.number}


def _level(episode):
    """An episode whose pitch is measured, and small."""
    pose = episode.pose.copy()
    pose[:, 4] = 0.01
    return replace(episode, pose=pose)


@pytest.mark.thorough
def test_a_current_is_no_finding_and_said_to_be_hidden_where_nobody_measures_the_way():
    """Attitude, rates and depth are the same in water that drifts sideways; one that rises shows in the depth."""
    heavy = load_vehicle("bluerov2_heavy")
    logs = simulated_logs("bluerov2_heavy", [{"current": {"north": 0.2}}], episodes=3, seconds=16.0, seed=2)
    found = diagnose(restricted(logs[0], ("z", "roll", "pitch", "yaw", "p", "q", "r")), heavy)
    assert found.verdict is Verdict.NO_GAP
    (sentence,) = (sentence for sentence in found.cannot_tell if sentence.startswith("current"))
    assert sentence == "current (north, east) would leave no mark on this log"
    assert found.detectable["current"].value < 0.05, "down"
