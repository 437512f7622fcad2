"""A Doppler log that is not mounted as the vehicle file says: named with its value, beside positions or not."""

from dataclasses import replace

import pytest

from auv_torchrl.diagnosis import Verdict, diagnose
from auv_torchrl.diagnosis.axes import restricted
from auv_torchrl.effects import EFFECTS
from auv_torchrl.flightlog import read_flightlog, write_flightlog
from auv_torchrl.vehicle import load_vehicle, read_vehicle_file
from tests.flightlog.simulate import simulated_logs

PAPER = load_vehicle("paper")
LOGS = {"positions": ("x", "y", "z", "yaw", "u", "v", "w", "r"), "no position": ("z", "yaw", "u", "v", "w", "r")}
TURNED = [{"dvl_misalignment": {"angle": angle}} for angle in (0.1, 1.57)]
MOVED = {"dvl_lever_arm": {"arm_x": 0.2}}
FAULTY = {"dvl_misalignment": {"angle": 0.5}, "thruster_gain": {"gain_2": 0.3}}


def flown(changes):
    """A flight with everything in its log."""
    return simulated_logs("paper", [changes], episodes=3, seconds=20.0, seed=5, noise=(5e-3, 4e-3))[0]


def is_named(found, truth):
    """Demand that what was changed, and nothing else, explains the log, with the right values."""
    assert found.verdict is Verdict.EXPLAINED
    assert {effect.name for effect in found.effects} == set(truth)
    for effect in found.effects:
        told = {name: e.value for name, e in effect.parameters.items() if e.value != e.nominal}
        assert told == pytest.approx(truth[effect.name], abs=0.01)


@pytest.mark.parametrize(
    ("truth", "axes"),
    [
        pytest.param(TURNED[0], LOGS["no position"], id="6 degrees"),
        pytest.param(TURNED[1], LOGS["positions"], id="a quarter turn", marks=pytest.mark.thorough),
        pytest.param(MOVED, LOGS["positions"], id="0.2 m", marks=pytest.mark.thorough),
        pytest.param(FAULTY, LOGS["no position"], id="and a fault", marks=pytest.mark.thorough),
    ],
)
def test_a_mounting_is_named_with_its_value(truth, axes):
    """Against positions, and without them by how the vehicle answers its thrusters; a weak thruster beside it, too."""
    is_named(diagnose(restricted(flown(truth), axes), PAPER), truth)


@pytest.mark.thorough
def test_a_turned_compass_beside_a_doppler_log_is_not_taken_for_a_turned_doppler_log():
    """Both agree alike with positions; the thrusters tell."""
    truth = {"heading_bias": {"angle": -1.0}}
    is_named(diagnose(restricted(flown(truth), LOGS["positions"]), PAPER), truth)


@pytest.mark.thorough
def test_a_file_with_a_quarter_turn_is_read_and_its_mounting_named(tmp_path):
    """The finding says what the velocities would agree with; both sensors stay, and the diagnosis names the turn."""
    log = replace(flown(TURNED[1]), axes=(*LOGS["positions"][:3], "roll", "pitch", *LOGS["positions"][3:]))
    log = read_flightlog(write_flightlog(log, tmp_path / "log.csv"), PAPER)
    assert {finding.code for finding in log.findings} & {"dvl_mounting", "heading_offset"}
    is_named(diagnose(restricted(log, LOGS["positions"]), PAPER), TURNED[1])


@pytest.mark.thorough
def test_a_vehicle_whose_file_says_how_it_is_mounted_has_no_gap(tmp_path):
    """Neither reader nor diagnosis finds anything, and what is not as the file says counts from there."""
    mounting = {"dvl_turn": 1.57, "dvl_position": [0.5, 0.0, 0.3]}
    vehicle = load_vehicle({**read_vehicle_file("paper"), "sensors": mounting})
    truth = {"dvl_misalignment": {"angle": 1.57}, "dvl_lever_arm": {"arm_x": 0.5, "arm_z": 0.3}}
    log = read_flightlog(write_flightlog(flown(truth), tmp_path / "log.csv"), vehicle)
    assert not log.findings
    assert diagnose(log, vehicle).verdict is Verdict.NO_GAP
    assert EFFECTS["dvl_lever_arm"].nominal(vehicle) == {"arm_x": 0.0, "arm_y": 0.0, "arm_z": 0.0}


def test_without_a_doppler_log_the_log_says_that_it_cannot_tell():
    """Poses alone show no mark of it."""
    found = diagnose(restricted(flown(MOVED), ("x", "y", "z", "yaw")), PAPER)
    assert found.verdict is Verdict.NO_GAP
    assert {f"{name} would leave no mark on this log" for name in ("dvl_misalignment", "dvl_lever_arm")} <= set(
        found.cannot_tell
    )


def test_its_owner_is_told_what_to_do():
    """Turn it back, or enter where it sits."""
    (turn,) = EFFECTS["dvl_misalignment"].advise(PAPER, {"angle": 0.5}, {})
    (place,) = EFFECTS["dvl_lever_arm"].advise(PAPER, {"arm_x": 0.2, "arm_y": 0.0, "arm_z": 0.0}, {})
    assert "turn the Doppler log by -29°" in turn.do and "dvl_position): +0.20 m in x" in place.do
