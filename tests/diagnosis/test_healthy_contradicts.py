"""Healthy flights whose sensors contradict each other, and those that no coefficients explain."""

from dataclasses import replace

import numpy as np
import pytest

from auv_torchrl.diagnosis.axes import hold_attitude
from auv_torchrl.diagnosis.calibrate.calibration import calibrate_by_prediction
from auv_torchrl.diagnosis.doubt import unless_shared
from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.diagnosis.validate.healthy_flights import check_healthy_flight
from auv_torchrl.effects.effect import changed
from auv_torchrl.flightlog import POSE, VELOCITY, join
from auv_torchrl.flightlog.checks.frames import check_frames
from auv_torchrl.vehicle import load_vehicle
from tests.diagnosis.flown_logs import fly, hold
from tests.diagnosis.healthy_flights import FILE, OWN, flown

BOTH = (*POSE, *VELOCITY)
PAPER = hold(load_vehicle("paper"))


def with_pose(log, change):
    """The log with the poses (T, 6) of each episode changed."""
    return replace(log, episodes=tuple(replace(e, pose=change(e.pose.copy())) for e in log.episodes))


@pytest.fixture(scope="module")
def sound():
    """A flight whose poses and velocities agree."""
    return fly(FILE, {}, axes=BOTH, episodes=2, seconds=20.0)


def test_sound_sensors_are_all_kept(sound):
    """A flight whose sensors agree is what it was."""
    assert check_healthy_flight(sound) is sound


def test_positions_in_another_frame_are_left_out(sound):
    """Positions in a frame that is turned against the compass are left out, and the finding names them."""

    def turned(pose):
        cos, sin = np.cos(0.8), np.sin(0.8)
        pose[:, :2] = pose[:, :2] @ np.array([[cos, sin], [-sin, cos]])
        return pose

    found = check_healthy_flight(with_pose(sound, turned))
    assert set(found.axes) == set(BOTH) - {"x", "y", "z"}
    assert found.findings[-1].code == "healthy_contradicts_itself"
    assert found.findings[-1].columns == ("x", "y", "z")


def test_positions_go_with_attitudes(sound):
    """Where the attitude contradicts the rates, nothing turns velocities into positions: both are left out."""

    def drifting(pose):
        pose[:, 5] += 0.2 * np.sin(np.arange(len(pose)) / 5)
        return pose

    assert set(check_healthy_flight(with_pose(sound, drifting)).axes) == set(VELOCITY)


def test_rates_of_turn_show_that_a_vehicle_tilts(sound):
    """A log without roll and pitch whose gyro turns about these axes is of no vehicle that is held level."""
    vehicle = load_vehicle("bluerov2_heavy")
    rates = replace(sound, axes=VELOCITY)
    rolls = replace(
        rates, episodes=tuple(replace(e, velocity=e.velocity + 0.3 * (np.arange(6) == 3)) for e in rates.episodes)
    )
    assert hold_attitude(rolls, vehicle).free.tolist() == [1.0] * 6
    assert hold_attitude(rates, vehicle).free.tolist() == [1.0, 1.0, 1.0, 0.0, 0.0, 1.0]


def test_the_vehicle_that_predicts_better_is_kept():
    """Of two vehicles the one that predicts healthy flights better counts, with how far the file is from it."""
    log, settings = join([flown(name, seed=seed, seconds=12.0) for seed, name in ((1, "a"), (2, "b"))]), load_settings()
    found = calibrate_by_prediction(log, FILE, FILE, settings, ())
    assert found is not None
    estimate, known, excess = found
    drag = float(estimate.vehicle.linear_drag[2, 2] + estimate.vehicle.quadratic_drag[2] * 0.3)
    truth = float(OWN.linear_drag[2, 2] + OWN.quadratic_drag[2] * 0.3)
    push = float((estimate.vehicle.gain * estimate.vehicle.full_thrust)[4] / (OWN.gain * OWN.full_thrust)[4])
    assert drag / truth / push == pytest.approx(1.0, abs=0.15)
    assert max(abs(share) for share in estimate.corrections.values()) > 0.1
    assert (known.floor > 0).all() and excess > 0
    assert calibrate_by_prediction(log, FILE, OWN, settings, ()) is None


def test_a_doubt_that_healthy_flights_share_is_one_of_the_file():
    """Thrust that the file has wrong looks like a clock that is off, in every log of the vehicle alike."""

    def read(values, seed):
        log = fly(changed(PAPER, gain=0.3 * PAPER.gain), values, seed=seed)
        return replace(log, findings=tuple(check_frames(log.episodes, log.axes, PAPER)[2]))

    healthy, faulty = read({}, 1), read({"thruster_gain": {"gain_1": 0.5}}, 2)
    assert any(finding.limits for finding in faulty.findings)
    assert not any(finding.limits for finding in unless_shared(faulty.findings, [healthy]))
    assert unless_shared(faulty.findings, []) == faulty.findings
