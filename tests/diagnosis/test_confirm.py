"""Held-out stretches flown again in MuJoCo agree with the plain model, whatever the effect."""

from dataclasses import replace

import numpy as np
import pytest
from flown_logs import AXES, fly, hold

from auv_torchrl.diagnosis.identify.hypotheses import apply_values, load_settings
from auv_torchrl.diagnosis.validate.confirm import confirm, fly_again
from auv_torchrl.diagnosis.validate.predict import (
    closed_share,
    errors_by_kind,
    held_out_windows,
    predict,
    root_of_covariance,
)
from auv_torchrl.effects.effect import changed
from auv_torchrl.flightlog import Episode, FlightLog
from auv_torchrl.physics.kinematics import euler_angles
from auv_torchrl.simulator import PlainSimulator, at_rest, replay
from auv_torchrl.vehicle import load_vehicle

PAPER = load_vehicle("paper")
HELD = hold(PAPER)
SETTINGS = load_settings()
NOISE = {"x": 0.002, "y": 0.002, "z": 0.002, "yaw": 0.004}
FORCE = np.full(4, 0.5)  # N, N m
CHANGES = {
    "thruster_gain": {"gain_2": 0.4},
    "thruster_lag": {"time_constant": 0.1},
    "command_delay": {"delay": 0.17},
    "pose_delay": {"delay": 0.12},
    "heading_bias": {"angle": 0.2},
    "position_scale": {"factor": 1.25},
    "depth_scale": {"factor": 0.8},
    "battery_sag": {"rate": 0.4},
    "current": {"north": 0.15, "east": -0.1},
}


@pytest.mark.parametrize("effect", CHANGES)
def test_mujoco_confirms_the_effect_that_was_flown(effect):
    """With the true effect in it, MuJoCo predicts what was flown to the floor, and as the plain model does."""
    change = {effect: CHANGES[effect]}
    log = fly(HELD, change, seed=5, episodes=2, seconds=12.0)
    vehicles = [HELD, apply_values(HELD, change)]
    predictions = predict(log, vehicles, SETTINGS, NOISE, FORCE)
    confirmed = confirm(predictions, vehicles)
    plain, found = errors_by_kind(predictions)["position_m"], confirmed.position_m
    assert found is not None and confirmed.closed is not None
    assert found.after == pytest.approx(plain.after, abs=0.003)
    assert found.before == pytest.approx(plain.before, rel=0.02, abs=0.003)
    assert np.all(np.array(found.after) < 2 * np.array(found.floor))
    assert confirmed.closed > 0.9


@pytest.mark.parametrize("lost", [np.nan, np.inf])
def test_no_share_is_told_where_the_simulator_diverges(lost):
    """Neither beyond all numbers nor at infinity is there a gap of which a share could be closed."""
    vehicles = [HELD, apply_values(HELD, {"thruster_gain": {"gain_2": 0.4}})]
    log = fly(HELD, {"thruster_gain": {"gain_2": 0.4}}, seed=5, episodes=1, seconds=6.0)
    predictions = predict(log, vehicles, SETTINGS, NOISE, FORCE)
    assert closed_share(predictions) == pytest.approx(1.0, abs=0.1)
    predictions.error[0, 0, -1] = lost
    assert closed_share(predictions) is None


def test_mujoco_flies_commands_that_change_within_a_grid_step():
    """A log with commands at 100 Hz about the dead band is flown again as it was, not by mean commands."""
    rng = np.random.default_rng(0)
    fast = rng.uniform(-0.25, 0.25, (1200, 1, 6)) + np.repeat(rng.uniform(-0.3, 0.3, (24, 1, 6)), 50, axis=0)
    simulator = PlainSimulator(HELD.expand(1), 0.01)
    simulator.resume(at_rest(np.zeros((1, 3)), np.zeros(1), 6))
    flown = replay(simulator, fast.swapaxes(0, 1)).states[0, :-1]
    rows = flown[::5]
    pose = np.concatenate([rows[:, :3], np.stack(euler_angles(rows[:, 3:7]), -1)], -1)
    pose[:, 3:5] = np.nan
    parts = fast.reshape(-1, 5, 6)
    t = 0.05 * np.arange(len(rows), dtype=float)
    episode = Episode(0, t, pose, np.full_like(pose, np.nan), parts.mean(1), parts=parts)
    log = FlightLog("fast", (episode,), AXES)
    means = replace(log, episodes=(replace(episode, parts=None),))
    after = {}
    for name, given in {"parts": log, "means": means}.items():
        predictions = predict(given, [HELD, HELD], SETTINGS, NOISE, FORCE)
        found = confirm(predictions, [HELD, HELD]).position_m
        assert found is not None
        again = found.after[-1]
        assert again == pytest.approx(errors_by_kind(predictions)["position_m"].after[-1], abs=0.003)
        after[name] = again
    assert after["parts"] < 0.002
    assert after["means"] > 3 * after["parts"]


def test_late_poses_and_immediate_velocities_are_both_reported():
    """Where the log has velocities too, those of a vehicle with late poses run ahead of them."""
    change = {"pose_delay": {"delay": 0.2}}
    log = fly(HELD, change, seed=6, episodes=1, seconds=12.0, axes=(*AXES, "u", "v", "w", "r"))
    vehicles = [HELD, apply_values(HELD, change)]
    noise = {**NOISE, "u": 0.01, "v": 0.01, "w": 0.01, "r": 0.01}
    velocity = confirm(predict(log, vehicles, SETTINGS, noise, FORCE), vehicles).velocity
    assert velocity is not None and max(velocity.after) < 0.03


def test_a_vehicle_that_diverges_does_not_take_the_others_along():
    """A vehicle with negative drag is lost, the one beside it is not."""
    log = fly(HELD, {}, seed=7, episodes=1, seconds=8.0)
    predictions = predict(log, [HELD, HELD], SETTINGS, NOISE, FORCE)
    wild = changed(HELD, linear_drag=-300.0 * HELD.linear_drag)
    states = fly_again(predictions.windows, [wild, HELD], predictions.states[:, :, 0])
    assert not np.isfinite(states[:, 0, -1]).all()
    np.testing.assert_allclose(states[:, 1], predictions.states[:, 1], atol=2e-3)


@pytest.mark.parametrize("span", [4, 30])
def test_how_sure_a_start_is_is_known_however_unequally_samples_tell_its_numbers(span):
    """A root of the covariance gives that covariance, and is finite where information spans thirty powers of ten."""
    random = np.random.default_rng(3)
    slope = random.normal(size=(5, 40, 9)) * 10.0 ** np.linspace(-span / 4, span / 4, 9)
    slope[..., 4] = slope[..., 3]  # two numbers that only the prior tells apart
    widths = np.geomspace(0.1, 10.0, 9)
    root = root_of_covariance(slope.swapaxes(1, 2) @ slope, widths, 4)
    assert np.isfinite(root).all()
    assert (np.einsum("wnk,wnk->wn", root, root) <= (1 + 1e-9) * widths[:4] ** 2).all()
    if span == 4:  # where the inverse still holds digits
        covariance = np.linalg.inv(slope.swapaxes(1, 2) @ slope + np.diag(widths**-2.0))[:, :4, :4]
        np.testing.assert_allclose(root @ root.swapaxes(1, 2), covariance, rtol=1e-6, atol=1e-12)


def test_nothing_is_closed_where_there_was_no_gap():
    """On a log of the vehicle itself, MuJoCo reports no share: nothing was open."""
    log = fly(HELD, {}, seed=7, episodes=4, seconds=8.0)
    assert confirm(predict(log, [HELD, HELD], SETTINGS, NOISE, FORCE), [HELD, HELD]).closed is None


def test_simulated_flights_are_shown_as_their_sensors_would_report_them():
    """A vehicle with its compass and gauge off is drawn where the log has it, the one before where it is not."""
    change = {"heading_bias": {"angle": 0.5}, "depth_scale": {"factor": 1.3}, "depth_bias": {"offset": 2.0}}
    log = fly(HELD, change, seed=5, episodes=2, seconds=12.0)
    windows = held_out_windows(predict(log, [HELD, apply_values(HELD, change)], SETTINGS, NOISE, FORCE), log)
    for window in windows:
        assert np.nanmax(np.abs(window.after.pose - window.measured.pose)) < 0.1


def test_simulated_headings_do_not_jump_at_half_a_turn():
    """Where the heading passes south, simulated headings go on from the measured one, as the log does."""
    log = fly(HELD, {}, seed=5, episodes=2, seconds=12.0)
    windows = held_out_windows(predict(log, [HELD, HELD], SETTINGS, NOISE, FORCE), log)
    assert max(np.abs(window.measured.pose[:, 5]).max() for window in windows) > np.pi
    for window in windows:
        for simulated in (window.before, window.after):
            np.testing.assert_allclose(simulated.pose[:, 5], window.measured.pose[:, 5], atol=0.1)
