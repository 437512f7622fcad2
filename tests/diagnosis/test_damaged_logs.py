"""What is wrong with a log is not blamed on its vehicle."""

from dataclasses import replace

import numpy as np
import pytest
from flown_logs import AXES, fly, hold

from auv_torchrl.diagnosis import diagnose
from auv_torchrl.diagnosis.identify.hypotheses import batch
from auv_torchrl.diagnosis.motion.actuation import actuate
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.motion.force import MeasuredMotion, middles, reading_changes, responses
from auv_torchrl.diagnosis.motion.smooth import Layout, flown, follow, rough_force
from auv_torchrl.diagnosis.verdict import Verdict
from auv_torchrl.flightlog import Finding, Severity
from auv_torchrl.physics import prepare
from auv_torchrl.vehicle import load_vehicle

HELD = hold(load_vehicle("paper"))
NOISE = {"x": 0.002, "y": 0.002, "z": 0.002, "yaw": 0.004, "u": 1e-3, "v": 1e-3, "w": 1e-3, "r": 1e-3}
BOTH = (*AXES, "u", "v", "w", "r")
THOROUGH = pytest.mark.thorough  # by make test-all
SENSORS = {
    "position_scale": ("factor", 0.02),
    "depth_scale": ("factor", 0.02),
    "velocity_scale": ("factor", 0.02),
}


@pytest.fixture(scope="module")
def sound():
    return fly(HELD, {}, seed=11, episodes=3, seconds=20.0)


def named(diagnosis):
    return {effect.name for effect in diagnosis.effects}


@pytest.mark.parametrize(
    "angle", [np.pi, pytest.param(np.pi / 2, marks=THOROUGH), pytest.param(-np.pi / 2, marks=THOROUGH)]
)
def test_a_heading_that_is_far_off_is_a_compass_and_not_four_thrusters(angle):
    """Backwards or across: the compass is named, with its angle."""
    diagnosis = diagnose(fly(HELD, {"heading_bias": {"angle": angle}}, seed=12, episodes=3, seconds=20.0), HELD)
    assert named(diagnosis) == {"heading_bias"}
    (effect,) = diagnosis.effects
    off = effect.parameters["angle"].value - angle
    assert abs(np.angle(np.exp(1j * off))) < 0.02


@pytest.mark.thorough
def test_exchanged_thrusters_on_a_vehicle_turned_round_are_declared_beside_those_that_would_look_the_same():
    """A compass that points backwards and two thrusters exchanged in front are two exchanged behind to any such log."""
    given = {"heading_bias": {"angle": np.pi}, "thruster_swap": {"command_2": 3.0, "command_3": 2.0}}
    diagnosis = diagnose(fly(HELD, given, seed=15, episodes=3, seconds=15.0), HELD)
    assert {"heading_bias with thruster_swap 2 3", "thruster_swap 1 4"} in map(set, diagnosis.indistinguishable)


@pytest.mark.parametrize(
    ("effect", "value"), [("position_scale", 1.25), pytest.param("position_scale", 0.8, marks=THOROUGH)]
)
def test_a_scale_of_the_position_is_named_with_its_value(effect, value):
    """A sensor that is a fifth off is no drag, thrust or inertia."""
    diagnosis = diagnose(fly(HELD, {effect: {"factor": value}}, seed=13, episodes=3, seconds=20.0), HELD)
    assert named(diagnosis) == {effect}
    assert diagnosis.effects[0].parameters["factor"].value == pytest.approx(value, rel=0.01)
    assert diagnosis.where.origin["sensing"] == pytest.approx(1.0)


@pytest.mark.thorough
def test_z_up_is_declared_beside_reversed_thrusters_and_none_is_believed():
    """The two are the same to a log of poses; a finding about frames keeps both below one half."""
    log = fly(HELD, {"depth_scale": {"factor": -1.0}}, seed=14, episodes=3, seconds=20.0)
    doubt = Finding(Severity.WARNING, "z_up_or_reversed", "heave goes against the thrusters", "", ("z",), limits=True)
    free = diagnose(log, HELD)
    limited = diagnose(replace(log, findings=(doubt,)), HELD)
    assert free.verdict is Verdict.EXPLAINED and limited.verdict is Verdict.PARTLY_EXPLAINED
    assert {"depth_scale", "thruster_gain"} in [set(group) for group in free.indistinguishable]
    assert max(effect.probability for effect in free.effects) > 0.9
    assert max(effect.probability for effect in limited.effects) <= 0.5
    assert limited.summary.startswith("The log itself is in doubt")
    assert any(finding.limits for finding in limited.findings)


def test_outliers_that_no_check_left_out_count_less_and_are_said(sound):
    """Heavy tails on one per cent of the values neither make a gap nor hide."""
    rng = np.random.default_rng(0)
    episodes = []
    for e in sound.episodes:
        pose = e.pose.copy()
        hit = rng.random(len(e)) < 0.01
        pose[hit, 1] += rng.choice((-1, 1), hit.sum()) * 0.03
        episodes.append(replace(e, pose=pose))
    diagnosis = diagnose(replace(sound, episodes=tuple(episodes)), HELD)
    assert diagnosis.verdict is Verdict.NO_GAP
    assert [f.columns for f in diagnosis.findings if f.code == "outliers"] == [("y",)]


def test_a_slow_sensor_has_the_noise_that_it_has(sound):
    """Samples at 5 Hz, three of four filled in: the noise is that of the sensor, and nothing is found."""
    held = [np.repeat(1.0 * (np.arange(len(e)) % 4 > 0)[:, None], 12, axis=1) for e in sound.episodes]
    slow = tuple(replace(e, filled=filled) for e, filled in zip(sound.episodes, held, strict=True))
    diagnosis = diagnose(replace(sound, episodes=slow), HELD)
    assert diagnosis.verdict is Verdict.NO_GAP
    (noise,) = (finding.sentence for finding in diagnosis.findings if finding.code == "sensor_noise")
    sizes = dict(part.split()[:2] for part in noise.split(": ", 1)[1].split(", "))
    assert float(sizes["x"]) == pytest.approx(0.002, rel=0.3)
    assert float(sizes["yaw"]) == pytest.approx(0.004, rel=0.3)


def test_values_without_noise_are_doubted():
    """What no sensor could have said bounds every probability."""
    log = fly(HELD, {"thruster_gain": {"gain_2": 0.55}}, seed=20, episodes=3, seconds=12.0, noise=(0.0, 0.0))
    diagnosis = diagnose(log, HELD)
    assert "no_noise" in {finding.code for finding in diagnosis.findings}
    assert all(effect.probability <= 0.5 for effect in diagnosis.effects)


@pytest.mark.thorough
def test_a_healthy_log_with_the_fault_in_it_is_found_out():
    """The fault is named with its true size, and the healthy log is said not to be healthy."""
    fault = {"thruster_gain": {"gain_2": 0.55}}
    log, healthy = (fly(HELD, fault, seed=seed, episodes=3, seconds=20.0) for seed in (15, 16))
    diagnosis = diagnose(log, HELD, healthy=[healthy])
    assert diagnosis.effects[0].parameters["gain_2"].value == pytest.approx(0.55, abs=0.02)
    assert "healthy_not_healthy" in {finding.code for finding in diagnosis.findings}


def test_a_healthy_log_that_is_healthy_is_used():
    """Without a fault in it there is nothing to find out."""
    log = fly(HELD, {"thruster_gain": {"gain_2": 0.55}}, seed=17, episodes=3, seconds=14.0)
    diagnosis = diagnose(log, HELD, healthy=[fly(HELD, {}, seed=18, episodes=3, seconds=14.0)])
    codes = {finding.code for finding in diagnosis.findings}
    assert "floor_measured" in codes and "healthy_not_healthy" not in codes


@pytest.mark.parametrize("axes", [AXES, BOTH, ("u", "v", "w", "yaw", "r")], ids=["pose", "both", "velocity"])
@pytest.mark.parametrize("effect", SENSORS)
def test_the_mark_of_a_sensor_is_the_difference_of_two_simulations(effect, axes):
    """Along a motion that is followed, a small change of a sensor changes the samples as its mark says."""
    name, size = SENSORS[effect]
    windows = cut_windows(fly(HELD, {}, seed=19, episodes=1, seconds=16.0, axes=axes), 2.0, 0.5, 0.2)
    layout, one = Layout.of(windows, HELD, 0.2), batch(HELD, [{}])
    sigma = {channel: NOISE[channel] for channel in windows.channels}
    state = follow(windows, one, layout, sigma, np.full(len(layout.dof), 20.0), rough_force(windows, one, layout))
    _, states = flown(actuate(windows, one), layout, state.start[:, None], state.bins[:, None])
    other = batch(HELD, [{effect: {name: 1.0 + size}}])
    motion = middles(states[:, 0])
    before, after = (prepare(its).numpy() for its in (one, other))
    response = responses(windows, before, layout, state, MeasuredMotion.of(windows, before, motion).forces(after))
    read = reading_changes(windows, before, after, states[:, 0])
    response = (response if read is None else response + read)[..., 0]
    moved, _ = flown(actuate(windows, other), layout, state.start[:, None], state.bins[:, None])
    simulated = state.residual - moved[:, 0]
    apart = (simulated - response).reshape(windows.measured.shape)
    shown = np.abs(simulated).max()
    if shown < 1e-6:  # a sensor that the log does not have
        assert np.abs(response).max() < 1e-6
    else:
        assert np.sqrt((apart**2).mean()) < 0.15 * np.sqrt((simulated**2).mean())
