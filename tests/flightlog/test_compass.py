"""A compass that turns with the current drawn: found in what it measured, in flights whose truth is known."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auv_torchrl.flightlog.info import info_lines
from auv_torchrl.flightlog.streams import tabulate
from auv_torchrl.flightlog.streams.compass import COMPASSES, check_compass, interference
from auv_torchrl.flightlog.streams.stream import Sampling, Streams, VehicleFacts, by_name, stream
from auv_torchrl.physics.kinematics import matvec, quaternion_from_euler, rotation_matrix
from tests.flightlog.shared_data import shared
from tests.flightlog.vehicle_log import streams_of

EARTH = np.array([200.0, -30.0, 440.0])  # mG, north, east, down: about that of northern Europe
OFFSET = np.array([12.0, -7.0, 20.0])  # mG, that a calibration left
IRON = np.eye(3) + np.array([[0.02, 0.01, 0.0], [0.0, -0.03, 0.01], [0.01, 0.0, 0.02]])  # soft, likewise
FIELD = np.array([3.0, -4.0, 1.5])  # mG per ampere
SITL = ("healthy_a", "healthy_c", "stock_healthy_a", "dead_thruster3", "motdir1_minus", "buoyancy10N")


def smooth(rng, t, slowest: float):
    """A wandering number of size 1."""
    waves = [
        np.sin(2 * np.pi * f * t + p) for f, p in zip(rng.uniform(0.02, slowest, 8), rng.uniform(0, 6, 8), strict=True)
    ]
    return sum(waves) / 2


def flight(
    seed: int, field: Sequence[float] | np.ndarray = FIELD, seconds: float = 240.0, follows: float = 0.05, current=True
) -> Streams:
    """A vehicle that turns, tilts and draws current, with a compass, and a filter that follows it.

    ``field`` is in mG per ampere; ``follows`` is the share of the compass's error per s by which the filter turns.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 0.04)
    angles = np.stack([0.2 * smooth(rng, t, 0.3), 0.2 * smooth(rng, t, 0.3), 2.0 * smooth(rng, t, 0.08)], -1)
    drawn = 8.0 * np.clip(smooth(rng, t, 0.2), 0.0, 1.5) + 0.5  # A
    rotation = rotation_matrix(quaternion_from_euler(*angles.T))
    felt = (
        matvec(rotation.mT, EARTH) @ IRON.T
        + OFFSET
        + drawn[:, None] * np.asarray(field)
        + rng.normal(0, 3.0, (len(t), 3))
    )
    wrong = -(drawn * (field[0] * np.sin(angles[:, 2]) + field[1] * np.cos(angles[:, 2]))) / 200.0  # rad
    error = np.zeros(len(t))
    for k in range(1, len(t)):
        error[k] = error[k - 1] + 0.04 * follows * (wrong[k] - error[k - 1])
    roll, pitch = angles[:, 0], angles[:, 1]
    rates = np.gradient(angles, t, axis=0)
    p = rates[:, 0] - np.sin(pitch) * rates[:, 2]
    q = np.cos(roll) * rates[:, 1] + np.sin(roll) * np.cos(pitch) * rates[:, 2]
    r = -np.sin(roll) * rates[:, 1] + np.cos(roll) * np.cos(pitch) * rates[:, 2]
    gyro = np.stack([p, q, r], -1) + 0.0005 + rng.normal(0, 0.002, (len(t), 3))
    pulses = np.full((len(t), 8), 1500.0) + 200.0 * (drawn[:, None] - 0.5) / 12.0
    told = angles + error[:, None] * np.array([0.0, 0.0, 1.0])
    told[:, 2] = (told[:, 2] + np.pi) % (2 * np.pi) - np.pi
    volts = np.stack([np.full(len(t), 16.0), drawn if current else np.zeros(len(t))], -1)
    measured, names = Sampling.MEASURED, ("mx", "my", "mz")
    made = (
        stream("attitude", ("roll", "pitch", "yaw"), "rad", t[::2], told[::2], Sampling.ESTIMATED, "XKQ"),
        stream("gyro", "pqr", "rad/s", t, gyro, measured, "IMU"),
        stream("battery", ("voltage", "current"), ("V", "A"), t[::3], volts[::3], measured, "BAT"),
        stream("outputs", [f"C{n}" for n in range(1, 9)], "us", t, pulses, Sampling.SNAPSHOT, "RCOU"),
        stream("compass", names, "mG", t[1::3], felt[1::3], measured, "MAG 0"),
    )
    return Streams("dive", "ArduPilot DataFlash", by_name(made), VehicleFacts("ArduSub V4.5.0", "vectored_6dof", 8))


@pytest.mark.parametrize("seed", range(4))
def test_a_compass_beside_a_cable_is_found_with_its_size(seed):
    """Slope, heading error and the parameters that take it out, within their errors, beside soft iron and offsets."""
    (finding,) = check_compass(flight(seed), {"COMPASS_MOTCT": 2.0, "COMPASS_MOT_X": 1.0})
    assert finding.code == "compass_interference" and finding.columns == ("yaw",)
    assert "compass 1 turns with the current drawn" in finding.sentence and "° per ampere" in finding.sentence
    slope = slope_of(finding)
    assert slope == pytest.approx(np.hypot(*FIELD[:2]) / np.hypot(*EARTH[:2]), rel=0.15)
    told = {text.split()[0]: float(text.split()[2]) for text in finding.remedy.split("and ", 2)[2].split(", ")}
    assert told["COMPASS_MOT_X"] == pytest.approx(1.0 - FIELD[0], abs=0.6)
    assert told["COMPASS_MOT_Y"] == pytest.approx(-FIELD[1], abs=0.6)
    assert "set COMPASS_MOTCT to 2" in finding.remedy


def slope_of(finding):
    """The rad per ampere that a finding says, in degrees."""
    return np.radians(float(finding.sentence.split("(")[1].split("°")[0]))


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_a_compass_away_from_cables_is_sound(seed):
    """Neither soft iron, nor offsets, nor a gyro that drifts are taken for a current."""
    assert not check_compass(flight(seed, field=(0.0, 0.0, 0.0)), {})


def test_a_filter_that_follows_the_compass_does_not_hide_it():
    """The faster it follows, the less its heading and the compass differ; the gyro tells."""
    for follows in (0.0, 0.2, 1.0):
        (finding,) = check_compass(flight(1, follows=follows), {})
        assert slope_of(finding) == pytest.approx(0.0247, rel=0.2)


def test_where_no_current_is_measured_the_outputs_stand_for_it():
    """Then no parameter can be told, because the autopilot would have no current to go by either."""
    (finding,) = check_compass(flight(2, current=False), {})
    assert "of all thrusters at full command" in finding.sentence and "COMPASS_MOT" not in finding.remedy


def test_a_compass_that_is_not_used_is_not_looked_at():
    """Each by its own parameters."""
    streams = flight(3)
    (throttle,) = check_compass(streams, {"COMPASS_MOTCT": 1.0})
    assert "COMPASS_MOT" not in throttle.remedy  # its numbers are no milligauss per ampere
    both = dict(streams.streams) | {"compass_2": replace(streams.streams["compass"], name="compass_2")}
    streams = replace(streams, streams=both)
    first, second = check_compass(streams, {"COMPASS_MOT2_Y": 2.0})
    assert "compass 2" in second.sentence and "COMPASS_MOT2_X" in second.remedy and "COMPASS_MOT_X" in first.remedy
    assert check_compass(streams, {"COMPASS_USE2": 0.0}) == [first]


def test_a_log_that_is_too_short_or_draws_nothing_says_nothing():
    """Nor one without attitude, nor one whose compass is not a number."""
    streams = flight(0)
    assert not check_compass(flight(0, seconds=20.0), {})
    for missing in ("attitude", "compass"):
        left = {name: each for name, each in streams.streams.items() if name != missing}
        assert not check_compass(replace(streams, streams=left), {})
    t, turn = np.arange(0, 100, 0.1), np.broadcast_to(np.eye(3), (1000, 3, 3))
    assert interference(t, np.full((1000, 3), np.nan), turn, t) is None
    assert interference(t, np.ones((1000, 3)), turn, np.ones(1000)) is None


@pytest.mark.parametrize("name", SITL)
def test_flights_of_the_firmware_have_sound_compasses(name):
    """ArduSub's own simulation has no interference, and draws up to 40 A."""
    streams = streams_of(shared(f"ardusub_sitl/{name}.BIN"))
    assert set(COMPASSES) <= streams.streams.keys()
    assert not check_compass(streams, streams.vehicle.parameters)


def test_interference_on_a_flight_of_the_firmware_is_found():
    """Put upon one of its three compasses, it is found there alone, and said by every command that reads the log."""
    streams = streams_of(shared("ardusub_sitl/healthy_a.BIN"))
    compass, battery = streams.streams["compass_2"], streams.streams["battery"]
    drawn = np.interp(compass.t, battery.t, battery.values[:, 1])
    put = replace(compass, values=compass.values + drawn[:, None] * np.array([0.5, 1.0, 0.0]))
    streams = replace(streams, streams=dict(streams.streams) | {"compass_2": put})
    (finding,) = check_compass(streams, streams.vehicle.parameters)
    assert "compass 2" in finding.sentence and "COMPASS_MOT2_X to -0." in finding.remedy
    slope = slope_of(finding)
    assert slope == pytest.approx(np.hypot(0.5, 1.0) / 190.0, rel=0.15)
    assert finding in tabulate(streams).findings and any(str(finding) in line for line in info_lines(streams))


def test_both_compasses_of_a_real_dive_feel_the_same():
    """They sit on one board, where 5 mG/A aft and 5 to starboard come from the current."""
    streams = streams_of(shared("ardusub_real/guided_00000029_filtered.BIN"))
    found = check_compass(streams, {})
    assert [finding.sentence.split()[1] for finding in found] == ["1", "2"]
    slopes = [slope_of(finding) for finding in found]
    assert slopes == pytest.approx([0.032, 0.033], abs=0.003)
