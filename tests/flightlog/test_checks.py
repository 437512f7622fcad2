"""What is wrong with a log is found, named and left out; what is right is not suspected."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from auv_torchrl.flightlog import FlightLogError, Severity, read_flightlog, write_flightlog
from auv_torchrl.flightlog.checks.frames import check_frames
from auv_torchrl.flightlog.log import Episode, FlightLog
from auv_torchrl.vehicle import load_vehicle
from tests.flightlog.simulate import POSE_ONLY, simulated_logs
from tests.flightlog.test_reader import column, rows_of, store
from tests.hovering import ACTING

FULL = ("x", "y", "z", "roll", "pitch", "yaw", "u", "v", "w", "p", "q", "r")
VELOCITIES = ("u", "v", "w", "p", "q", "r")
FELT = ("z", "roll", "pitch", "yaw", "p", "q", "r", "ax", "ay", "az")
CLEAR = {  # one clear value per effect, harsh enough to look like something else
    "thruster_gain": {"gain_2": -1.0},
    "thruster_swap": {"command_1": 2.0, "command_2": 1.0, "command_3": 4.0, "command_4": 3.0},
    "thruster_misalignment": {"angle_3": 1.5},
    "thrust_limit": {f"limit_{i}": 15.0 for i in range(1, 7)},
    "dead_band": {"width": 15.0},
    "thrust_curve": {"exponent": 2.0},
    "forward_gain": {"gain_1": 0.0},
    "reverse_gain": {"gain_3": 0.0, "gain_5": 0.0},
    "neutral_offset": {"offset_2": 0.2},
    "thruster_lag": {"time_constant": 0.8},
    "command_delay": {"delay": 0.6},
    "battery_sag": {"rate": 0.7},
    "hull": {"linear_sway": 100.0, "quadratic_sway": 300.0, "added_mass_heave": 40.0},
    "linear_drag": {"scale_surge": 5.0},
    "quadratic_drag": {"scale_sway": 5.0},
    "drag_coupling": {"drag_yaw_from_sway": 30.0},
    "added_mass": {"scale_yaw": 4.0},
    "coriolis": {"strength": 1.0},
    "payload": {"mass": 8.0, "weight": 30.0, "x": 0.2},
    "buoyancy": {"force": 30.0},
    "mass_offset": {"x": 0.1},
    "current": {"north": 0.4, "east": 0.3},
    "tether": {"north": 2.0, "stiffness": 40.0, "slack": 0.5},
    "heading_bias": {"angle": -3.0},
    "pose_delay": {"delay": 0.5},
    "position_scale": {"factor": 1.3},
    "depth_scale": {"factor": 0.8},
    "depth_bias": {"offset": 0.5},
    "velocity_scale": {"factor": 0.7},
    "gyro_bias": {"bias_r": 0.05},
    "dvl_misalignment": {"angle": 1.57},
    "dvl_lever_arm": {"arm_x": 0.5, "arm_z": 0.3},
    "accelerometer_bias": {"bias_ax": 1.5, "bias_az": -1.5},
    "thruster_place": {"x_1": 0.1, "z_2": -0.1},
    "free_surface": {"depth": -0.5, "air": 1.0},
    "drag_asymmetry": {"asymmetry_surge": 0.5, "asymmetry_heave": -0.5},
    "sensor_noise": {"position": 0.05, "attitude": 0.05},
    "reaction_torque": {"arm_5": 0.05, "arm_6": 0.05},
    "compass_interference": {"angle": 0.5},
}
TRUE_OF = {  # findings that are right about a log with this effect
    "heading_bias": {"heading_offset"},
    "pose_delay": {"pose_velocity_disagree"},
    "position_scale": {"pose_velocity_disagree"},
    "velocity_scale": {"pose_velocity_disagree"},
    "dvl_misalignment": {"heading_offset", "dvl_mounting"},
    "dvl_lever_arm": {"dvl_mounting"},
}


@pytest.fixture(scope="module")
def paper():
    return load_vehicle("paper")


@pytest.fixture(scope="module")
def healthy():
    """A log with everything measured."""
    return simulated_logs("paper", [{}])[0]


@pytest.fixture(scope="module")
def pose_only(healthy):
    return replace(healthy, axes=POSE_ONLY)


def codes(log: FlightLog) -> set[str]:
    return {finding.code for finding in log.findings}


def reread(log: FlightLog, vehicle, tmp_path) -> FlightLog:
    return read_flightlog(write_flightlog(log, tmp_path / "log.csv"), vehicle)


def changed(log: FlightLog, change) -> FlightLog:
    """The log with ``change(episode)`` giving new fields of each episode."""
    return replace(log, episodes=tuple(replace(e, **change(e)) for e in log.episodes))


@pytest.fixture(scope="module")
def faulty():
    """Gives the named vehicle, and a log of it with each effect, which are flown once."""

    @cache
    def flown(name):
        changes = [{effect: values} for effect, values in CLEAR.items()]
        logs = simulated_logs(name, changes, seed=4, alike=True, felt=0.02)
        return load_vehicle(name), dict(zip(CLEAR, logs, strict=True))

    return flown


LOGGED = {"full": FULL, "pose": POSE_ONLY, "velocity": VELOCITIES, "felt": FELT}
LONG = {
    ("paper", "full"),
    ("paper", "pose"),
    ("paper", "velocity"),
    *(("bluerov2_heavy", what) for what in LOGGED if what != "velocity"),
}  # to read


@pytest.mark.parametrize(
    ("name", "axes"),
    [
        pytest.param(name, axes, id=f"{name}-{what}", marks=pytest.mark.thorough if (name, what) in LONG else ())
        for name in ("paper", "bluerov2_heavy")
        for what, axes in LOGGED.items()
    ],
)
def test_sound_logs_of_faulty_vehicles_are_not_suspected(faulty, name, axes, tmp_path):
    """A log in the right format gives no finding, whichever effect acts on the vehicle."""
    assert set(CLEAR) == set(ACTING)
    vehicle, logs = faulty(name)
    for effect, log in logs.items():
        path = write_flightlog(replace(log, axes=axes), tmp_path / f"{effect}.csv")
        assert codes(read_flightlog(path, vehicle)) <= TRUE_OF.get(effect, set()), effect


def east_north_up(e: Episode):
    pose = e.pose[:, [1, 0, 2, 3, 4, 5]] * np.array([1, 1, -1, 1, -1, -1]) + np.array([0, 0, 0, 0, 0, np.pi / 2])
    return {"pose": pose}


@pytest.mark.parametrize(
    ("change", "axes"),
    [
        (east_north_up, POSE_ONLY),
        (east_north_up, FULL),
        (lambda e: {**east_north_up(e), "velocity": e.velocity * np.array([1, -1, -1, 1, -1, -1])}, FULL),
        (lambda e: {"pose": e.pose[:, [1, 0, 2, 3, 4, 5]]}, POSE_ONLY),
        (lambda e: {"pose": e.pose * np.array([1, 1, 1, 1, 1, -1])}, POSE_ONLY),
        (lambda e: {"pose": e.pose * np.array([1, 1, -1, 1, 1, 1])}, FULL),
        (
            lambda e: {"velocity": np.concatenate((np.gradient(e.pose[:, :3], e.t, axis=0), e.velocity[:, 3:]), -1)},
            FULL,
        ),
    ],
    ids=["enu", "enu_frd", "enu_flu", "east_north", "yaw_counter_clockwise", "z_up", "earth_velocity"],
)
def test_wrong_frames_are_errors(healthy, paper, tmp_path, change, axes):
    """ENU for NED, axes exchanged, and earth velocities for body velocities are found and refer to NED and FRD."""
    log = reread(replace(changed(healthy, change), axes=axes), paper, tmp_path)
    errors = [finding for finding in log.findings if finding.severity is Severity.ERROR]
    assert len(errors) == 1
    assert errors[0].code in ("wrong_frame", "z_up")
    assert "down" in errors[0].remedy


def test_z_up_or_reversed_vertical_thrusters_stays_open(healthy, paper, tmp_path):
    """With a pose alone, z up looks like reversed vertical thrusters, and the finding says both."""
    upside = changed(healthy, lambda e: {"pose": e.pose * np.array([1, 1, -1, 1, 1, 1])})
    log = reread(replace(upside, axes=POSE_ONLY), paper, tmp_path)
    assert [(f.code, f.severity) for f in log.findings] == [("z_up_or_reversed", Severity.WARNING)]


def test_the_frame_of_a_firmware_is_not_in_doubt(healthy, paper):
    """Where the log is a firmware's, a vehicle that heaves against its thrusters has thrusters that are wrong."""
    upside = changed(
        healthy,
        lambda e: {"pose": e.pose * np.array([1, 1, -1, 1, 1, 1]), "velocity": np.full_like(e.velocity, np.nan)},
    )
    for known, code in ((False, "z_up_or_reversed"), (True, "against_thrusters")):
        (found,) = check_frames(upside.episodes, POSE_ONLY, paper, frame_known=known)[2]
        assert found.code == code and found.limits is not known


@pytest.mark.parametrize("axes", [POSE_ONLY, FULL], ids=["pose", "full"])
@pytest.mark.parametrize("wrapped", [True, False])
def test_degrees_are_converted_and_reported(healthy, paper, tmp_path, axes, wrapped):
    """Angles in degrees, wrapped or not, come back in radians with a finding that names the columns."""
    turn = np.array([1, 1, 1, *3 * [180 / np.pi]])
    angles = (lambda pose: pose) if wrapped else (lambda pose: np.unwrap(pose, axis=0))
    degrees = changed(healthy, lambda e: {"pose": angles(e.pose) * turn})
    log = reread(replace(degrees, axes=axes), paper, tmp_path)
    assert codes(log) == {"degrees"}
    assert "yaw" in log.findings[0].columns
    for there, here in zip(healthy.episodes, log.episodes, strict=True):
        np.testing.assert_allclose(np.cos(here.pose[:, 5] - there.pose[:, 5]), 1, atol=1e-8)


def test_unwrapped_radians_are_not_taken_for_degrees(healthy, paper, tmp_path):
    """A heading that counts turns is wrapped without a finding."""
    spun = changed(healthy, lambda e: {"pose": np.unwrap(e.pose, axis=0) + np.array([0, 0, 0, 0, 0, 8 * np.pi])})
    log = reread(spun, paper, tmp_path)
    assert not log.findings
    assert max(np.abs(e.pose[:, 5]).max() for e in log.episodes) <= np.pi


def test_degrees_per_second_are_converted(healthy, paper, tmp_path):
    """Angular rates in degrees per second come back in radians per second."""
    fast = changed(healthy, lambda e: {"velocity": e.velocity * np.array([1, 1, 1, *3 * [180 / np.pi]])})
    log = reread(fast, paper, tmp_path)
    assert codes(log) == {"degrees"}
    np.testing.assert_allclose(log.episodes[0].velocity, healthy.episodes[0].velocity, atol=1e-5)


@pytest.mark.parametrize(("scale", "offset", "remedy"), [(400, 1500, "1500"), (100, 0, "100")])
def test_commands_in_other_units_are_refused(pose_only, paper, tmp_path, scale, offset, remedy):
    """Pulse widths and per cent are refused with the formula that converts them."""
    path = write_flightlog(
        changed(pose_only, lambda e: {"commands": e.commands * scale + offset}), tmp_path / "log.csv"
    )
    with pytest.raises(FlightLogError, match=f"cmd_1.*{remedy}"):
        read_flightlog(path, paper)


def test_milliseconds_are_refused(pose_only, paper, tmp_path):
    """Time in milliseconds is refused."""
    path = write_flightlog(changed(pose_only, lambda e: {"t": e.t * 1e3}), tmp_path / "log.csv")
    with pytest.raises(FlightLogError, match="milliseconds"):
        read_flightlog(path, paper)


@pytest.mark.parametrize("gap", ["", "nan", "NaN", "oops", "inf"])
def test_rows_without_a_number_are_left_out(pose_only, paper, tmp_path, gap):
    """A row that lacks a number is left out, the finding names column and rows, and the rest is used."""
    rows = rows_of(pose_only, tmp_path / "whole.csv")
    for row in (100, 101, 300):
        rows[row][column(rows, "x")] = gap
    log = read_flightlog(store(tmp_path / "log.csv", rows), paper)
    assert log.samples == pose_only.samples - 3
    finding = next(f for f in log.findings if f.code == "missing_values")
    assert finding.rows == (100, 300)
    assert finding.columns == ("x",)


def test_commands_of_left_out_rows_act_on(pose_only, paper, tmp_path):
    """Where a pose is missing, the command from the last measured row on is the mean over the time until the next."""
    rows = rows_of(pose_only, tmp_path / "whole.csv")
    rows[100][column(rows, "x")] = ""
    log = read_flightlog(store(tmp_path / "log.csv", rows), paper)
    there = pose_only.episodes[0].commands
    np.testing.assert_allclose(log.episodes[0].commands[98], (there[98] + there[99]) / 2, atol=1e-6)


def test_ragged_rows_are_left_out(pose_only, paper, tmp_path):
    """Rows with too many or too few values are counted and skipped."""
    rows = rows_of(pose_only, tmp_path / "whole.csv")
    rows[50] = rows[50][:-1]
    rows[70] = [*rows[70], "1"]
    log = read_flightlog(store(tmp_path / "log.csv", rows), paper)
    assert log.samples == pose_only.samples - 2
    finding = next(f for f in log.findings if f.code == "ragged_rows")
    assert finding.rows == (50, 70)


def test_time_glitches_are_left_out(pose_only, paper, tmp_path):
    """Single rows with repeated, backward or far-ahead time are left out without cutting the log."""
    rows = rows_of(pose_only, tmp_path / "whole.csv")
    t = column(rows, "t")
    rows[51][t] = rows[50][t]
    rows[100][t] = "1.0"
    rows[200][t] = "9999"
    log = read_flightlog(store(tmp_path / "log.csv", rows), paper)
    assert codes(log) == {"time_not_increasing"}
    assert len(log.episodes) == len(pose_only.episodes)
    assert log.samples == pose_only.samples - 3
    assert all((np.diff(e.t) > 0).all() for e in log.episodes)


def test_time_that_starts_over_begins_an_episode(pose_only, paper, tmp_path):
    """Without an episode column, a clock that starts over separates the flights."""
    rows = rows_of(pose_only, tmp_path / "whole.csv")
    rows = [row[1:] for row in rows]
    log = read_flightlog(store(tmp_path / "log.csv", rows), paper)
    assert codes(log) == {"time_starts_over"}
    assert [len(e) for e in log.episodes] == [len(e) for e in pose_only.episodes]


def test_gaps_cut_the_log_and_keep_its_time(pose_only, paper, tmp_path):
    """A pause ends an episode; the part behind it keeps its time, and the finding names the rows around the pause."""
    rows = rows_of(pose_only, tmp_path / "whole.csv")
    del rows[201:301]
    log = read_flightlog(store(tmp_path / "log.csv", rows), paper)
    assert [f.rows for f in log.findings if f.code == "gap"] == [(200, 201)]
    assert len(log.episodes) == len(pose_only.episodes) + 1
    assert log.episodes[1].t[0] == pytest.approx(pose_only.episodes[0].t[300])


def test_positions_off_the_path_are_left_out(pose_only, paper, tmp_path):
    """A single wrong fix is left out; a jump of the path cuts the log."""
    rows = rows_of(pose_only, tmp_path / "whole.csv")
    x = column(rows, "x")
    rows[100][x] = "40.0"
    for row in range(300, 601):
        rows[row][x] = str(float(rows[row][x]) + 7.0)
    log = read_flightlog(store(tmp_path / "log.csv", rows), paper)
    assert [f.rows for f in log.findings if f.code == "outliers"] == [(100, 100)]
    assert [f.rows for f in log.findings if f.code == "jump"] == [(299, 300)]
    assert log.episodes[0].filled is not None
    assert [tuple(at) for at in np.argwhere(log.episodes[0].filled)] == [(99, 0)]  # x of that row, and nothing else
    assert log.episodes[0].pose[99, 0] == pytest.approx(pose_only.episodes[0].pose[99, 0], abs=0.02)


def test_an_axis_that_is_mostly_missing_is_left_out(pose_only, paper, tmp_path):
    """An axis without numbers costs itself, not the log."""
    rows = rows_of(pose_only, tmp_path / "whole.csv")
    for row in rows[1:]:
        row[column(rows, "z")] = ""
    log = read_flightlog(store(tmp_path / "log.csv", rows), paper)
    assert log.axes == ("x", "y", "yaw")
    assert log.samples == pose_only.samples
    assert ("sparse_axis", ("z",)) in [(f.code, f.columns) for f in log.findings]


@pytest.mark.parametrize(
    ("commands", "code"),
    [
        (lambda c: 0 * c + 0.3, "constant_commands"),
        (lambda c: c * np.array([0, 1, 1, 1, 1, 1]), "unused_thruster"),
        (lambda c: np.where(np.arange(len(c))[:, None] % 50 < 49, 1.0, -1.0) * np.ones_like(c), "saturated"),
    ],
)
def test_commands_that_show_little_are_reported(pose_only, paper, tmp_path, commands, code):
    """Constant, unused and saturated commands are findings that name the columns."""
    log = reread(changed(pose_only, lambda e: {"commands": commands(e.commands)}), paper, tmp_path)
    finding = next(f for f in log.findings if f.code == code)
    assert finding.columns[0] == "cmd_1"


def test_two_seconds_are_read_and_reported(pose_only, paper, tmp_path):
    """A log of 2 s is a log, and its findings say how little it shows."""
    brief = replace(pose_only, episodes=(pose_only.episodes[0].rows(0, 41),))
    log = reread(brief, paper, tmp_path)
    assert {"short_log", "one_episode", "frames_not_checked"} <= codes(log)
    assert log.duration == pytest.approx(2.0)


def test_half_a_second_is_refused(pose_only, paper, tmp_path):
    """Nothing can be said about a few samples."""
    path = write_flightlog(replace(pose_only, episodes=(pose_only.episodes[0].rows(0, 6),)), tmp_path / "log.csv")
    with pytest.raises(FlightLogError, match="shorter than"):
        read_flightlog(path, paper)


def test_a_fast_log_is_averaged_without_delay(paper, tmp_path):
    """At 100 Hz the log is thinned to 20 Hz; a steady motion keeps its phase and its noise shrinks."""
    n, noise = 6000, 0.01
    rng = np.random.default_rng(0)
    t = np.arange(n, dtype=float) * 0.01
    pose = np.zeros((n, 6))
    pose[:, 0] = 0.2 * t
    pose[:, 5] = np.angle(np.exp(0.5j * t))
    commands = np.sin(t[:, None] * np.arange(1, 7))
    noisy = pose + noise * rng.normal(size=pose.shape) * np.array([1, 1, 1, 0, 0, 0])
    fast = FlightLog("fast", (Episode(0, t, noisy, np.full((n, 6), np.nan), commands),), POSE_ONLY)
    log = reread(fast, paper, tmp_path)
    assert {f.code for f in log.findings if f.severity is not Severity.INFO} == set()
    episode = log.episodes[0]
    assert len(episode) == n // 5
    assert (episode.pose[:, 0] - 0.2 * episode.t)[1:-1].std() == pytest.approx(noise / np.sqrt(5), rel=0.1)
    assert abs((episode.pose[:, 0] - 0.2 * episode.t).mean()) < 1e-3
    np.testing.assert_allclose(np.cos(episode.pose[:, 5] - 0.5 * episode.t), 1, atol=1e-6)
    np.testing.assert_allclose(episode.commands[3], commands[15:20].mean(axis=0), atol=1e-6)
    assert episode.parts is not None
    np.testing.assert_allclose(episode.parts[:-1], commands[:-5].reshape(-1, 5, 6), atol=1e-6)
    held = replace(fast, episodes=(replace(fast.episodes[0], commands=np.repeat(commands[::5], 5, axis=0)),))
    path = write_flightlog(held, tmp_path / "held.csv")
    assert read_flightlog(path, paper).episodes[0].parts is None


def test_many_findings_of_one_kind_become_one(pose_only, paper, tmp_path):
    """A log with a gap every second gives one finding about its gaps, with their number."""
    rows = rows_of(pose_only, tmp_path / "whole.csv")
    kept = [rows[0], *(row for i, row in enumerate(rows[1:]) if i % 40 < 20)]
    log = read_flightlog(store(tmp_path / "log.csv", kept), paper)
    gaps = [f for f in log.findings if f.code == "gap"]
    assert len(gaps) == 1
    assert "28 times in all" in gaps[0].sentence
