"""Cutting a log into windows."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auv_torchrl.diagnosis.motion.actuation import LEAST_STEP, actuate
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.motion.rollout import fly
from auv_torchrl.effects import EFFECTS
from auv_torchrl.flightlog import Episode, FlightLog
from auv_torchrl.flightlog.log import POSE, VELOCITY
from auv_torchrl.physics import ActiveTerms, prepare
from auv_torchrl.physics.kinematics import (
    euler_angles,
    matvec,
    quaternion_from_euler,
    quaternion_product,
    rotation_matrix,
)
from auv_torchrl.physics.thrusters import thrust_target
from auv_torchrl.simulator import simulate
from auv_torchrl.vehicle import load_vehicle, stacked


def _log(t: np.ndarray, commands: np.ndarray) -> FlightLog:
    pose = np.full((len(t), 6), np.nan)
    pose[:, [0, 1, 2, 5]] = 0.1 * t[:, None]
    velocity = np.full((len(t), 6), np.nan)
    return FlightLog("log", (Episode(0, t, pose, velocity, commands),), ("x", "y", "z", "yaw"))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([0.01, 0.05, 0.1, 0.19]))
def test_resampling_keeps_the_impulse_of_the_commands(seed, step):
    """The grid commands integrate to what the log commanded, whatever the sampling."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(step * rng.uniform(0.7, 1.3, 200))
    t -= t[0]
    commands = rng.uniform(-1, 1, (200, 2))
    windows = cut_windows(_log(t, commands), 1.5, 0.0)
    grid = windows.commands[0]
    end = len(grid) * windows.dt
    held = np.diff(np.append(t, max(end, t[-1])))
    inside = np.clip(end - t, 0.0, held)
    np.testing.assert_allclose(grid.sum(0) * windows.dt, (inside[:, None] * commands).sum(0), atol=1e-9)


rates = st.tuples(*[st.floats(-1.0, 1.0)] * 3)  # at twice as fast a parabola is 0.1 off


@settings(max_examples=50, deadline=None)
@given(st.tuples(*[st.floats(-3.0, 3.0)] * 3), rates, rates)
def test_a_window_begins_with_the_velocity_of_the_vehicle_however_it_is_tilted(angles, velocity, spin):
    """The guess of a start is that of the body, also where it points straight up and roll and yaw jump."""
    t: np.ndarray = np.arange(41) * 0.05
    size = np.linalg.norm(spin)
    axis = np.asarray(spin) / max(size, 1e-9)
    turned = np.concatenate([np.cos(size * t[:, None] / 2), np.sin(size * t[:, None] / 2) * axis], axis=1)
    attitude = quaternion_product(quaternion_from_euler(*np.array(angles)), turned)
    moving = matvec(rotation_matrix(attitude), np.asarray(velocity))
    position = np.cumsum(0.025 * (moving + np.roll(moving, 1, axis=0)) * (t > 0)[:, None], axis=0)
    pose = np.concatenate([position, np.stack(euler_angles(attitude), axis=1)], axis=1)
    log = FlightLog("log", (Episode(0, t, pose, np.full((41, 6), np.nan), np.zeros((41, 2))),), POSE)
    (guess,) = cut_windows(log, 1.5, 0.0).guess
    np.testing.assert_allclose(guess[6:], [*velocity, *spin], atol=0.1)
    rotation = rotation_matrix(quaternion_from_euler(*guess[3:6]))
    np.testing.assert_allclose(rotation, rotation_matrix(attitude[0]), atol=0.01)


def test_regular_samples_fall_on_the_grid():
    """At 20 Hz every sample of a window is a grid step and every command is the logged one."""
    t = 0.05 * np.arange(200)
    commands = np.random.default_rng(0).uniform(-1, 1, (200, 2))
    windows = cut_windows(_log(t, commands), 2.0, 0.5)
    assert not windows.fraction.any()
    assert windows.present.all()
    np.testing.assert_allclose(windows.commands[0], commands, atol=1e-9)


@pytest.mark.parametrize("row_s", [0.05, 0.0500003, 0.0502])
def test_a_clock_that_is_off_makes_no_grid_step_shorter(row_s):
    """Uneven rows of 20 Hz have two grid steps each, whatever the clock is off by."""
    t = row_s * np.arange(200) + np.where(np.arange(200) % 50 == 1, 0.01, 0.0)
    windows = cut_windows(_log(t, np.zeros((200, 2))), 1.5, 0.0)
    assert windows.dt == pytest.approx(row_s / 2)


@pytest.mark.parametrize("read", [False, True])
def test_thrusts_within_a_grid_step_are_averaged_and_not_commands(read):
    """At 100 Hz the thrust of a grid step is the mean of five thrusts: the dead band has cut each of them by itself."""
    vehicle = load_vehicle("paper").expand(1)
    commands = np.random.default_rng(0).uniform(-0.2, 0.2, (500, 6))
    log = _log(0.01 * np.arange(500), commands)
    if read:  # thinned by the reader, which keeps the parts
        (fast,) = log.episodes
        slow = replace(_log(0.05 * np.arange(100), commands.reshape(100, 5, 6).mean(1)).episodes[0], number=fast.number)
        log = replace(log, episodes=(replace(slow, parts=commands.reshape(100, 5, 6)),))
    windows = cut_windows(log, 2.0, 0.0)
    actuation = actuate(windows, vehicle)
    (found,) = actuation.targets(slice(0, len(windows)), np.arange(windows.steps))
    c = prepare(vehicle).numpy()
    thrusts = thrust_target(c, ActiveTerms.of(c), commands).reshape(100, 5, 6).mean(1)
    assert 0 < (thrusts == 0).mean() < 0.5
    np.testing.assert_allclose(found[:, 0], thrusts[: 40 * len(windows)].reshape(-1, 40, 6), atol=1e-9)


def test_a_log_without_a_window_says_what_is_needed():
    """A log of one second is refused with the length that is needed."""
    t = 0.05 * np.arange(20)
    with pytest.raises(ValueError, match="longer log"):
        cut_windows(_log(t, np.zeros((20, 2))), 2.0, 0.5)


@settings(max_examples=25, deadline=None)
@given(st.sampled_from(["paper", "bluerov2", "bluerov2_heavy"]), st.floats(0.0, 6.0))
def test_speeds_that_no_vehicle_has_do_not_make_a_rollout_endless(name, decades):
    """However fast a log says that a vehicle is, a grid step takes a bounded number of steps, and a slow one few."""
    vehicle = load_vehicle(name)
    t = 0.05 * np.arange(200)
    log = _log(t, np.zeros((len(t), vehicle.thrusters)))
    log.episodes[0].pose[:, 0] = 0.1 * 10**decades * t
    windows = cut_windows(log, 2.0, 0.5)
    substeps = actuate(windows, vehicle.expand(1)).substeps
    assert 1 <= substeps <= np.ceil(windows.dt / LEAST_STEP)
    assert decades > 1 or substeps <= 2


@pytest.mark.parametrize("name", ["paper", "bluerov2", "bluerov2_heavy", "ardusub_sitl"])
def test_rollouts_of_the_fastest_turns_are_as_exact_as_a_gyroscope(name):
    """Where full commands turn a vehicle, much shorter steps change no yaw rate by more than a gyroscope's noise."""
    vehicle, noise = load_vehicle(name), 0.005
    times: np.ndarray = 0.05 * np.arange(401)
    turning = np.repeat(np.random.default_rng(0).choice([-1.0, 1.0], 20), 20)
    commands = np.clip(turning[:, None] * vehicle.mixer[:, 5], -1, 1)
    flown = simulate(vehicle, commands[None], times).states[0]
    pose = np.concatenate([flown[:, :3], np.stack(euler_angles(flown[:, 3:7]), axis=-1)], axis=1)
    episode = Episode(0, times, pose, flown[:, 7:], np.concatenate([commands, commands[-1:]]))
    windows = cut_windows(FlightLog("turns", (episode,), (*POSE, *VELOCITY)), 2.0, 0.5)
    actuation = actuate(windows, vehicle.expand(1))
    found, exact = (
        windows.residual(fly(replace(actuation, substeps=parts * actuation.substeps), windows.guess[:, None])[0])
        for parts in (1, 8)
    )
    assert np.abs(flown[:, 12]).max() > 1.0
    assert np.abs(found - exact)[..., windows.channels.index("r")].max() < noise


@pytest.mark.parametrize("name", EFFECTS)
def test_vehicles_that_do_the_same_with_commands_are_worked_out_once(name):
    """Whatever an effect changes, the thrusts of a batch are those of each of its vehicles alone."""
    vehicle, effect = load_vehicle("paper"), EFFECTS[name]
    declared, nominal = effect.member_parameters(vehicle), effect.nominal(vehicle)
    ends = [{}] + [{m: p.high if p.high > nominal[m] else p.low} for m, p in declared.items() if not p.discrete]
    ends += [{m: 1.0} for m, p in declared.items() if p.discrete]
    changed = [effect.apply(vehicle.expand(1), values) for values in ends]
    windows = cut_windows(_log(0.05 * np.arange(100), np.random.default_rng(0).uniform(-1, 1, (100, 6))), 2.0, 1.0)
    both = stacked([one.reshape() for one in (*changed, *changed)])
    together = actuate(windows, both).targets(slice(0, len(windows)), np.arange(windows.steps))[0]
    for row, one in enumerate([*changed, *changed]):
        alone = actuate(windows, one).targets(slice(0, len(windows)), np.arange(windows.steps))[0]
        np.testing.assert_allclose(together[:, row], alone[:, 0], atol=1e-12)
