"""An accelerometer among the sensors of a log: simulated and linearised as it is logged, and what it then shows."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from auv_torchrl.diagnosis import Verdict, diagnose
from auv_torchrl.diagnosis.axes import followable, restricted
from auv_torchrl.diagnosis.identify.hypotheses import batch, load_settings
from auv_torchrl.diagnosis.motion.actuation import actuate
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.motion.rollout import fly
from auv_torchrl.diagnosis.motion.smooth import Layout, flown, local_slopes
from auv_torchrl.effects import EFFECTS
from auv_torchrl.effects.effect import changed
from auv_torchrl.physics import CONTROL_DT
from auv_torchrl.vehicle import load_vehicle
from tests.flightlog.simulate import simulated_logs, waves

STOCK = ("z", "roll", "pitch", "yaw", "p", "q", "r")
FELT = ("ax", "ay", "az")
HEAVY = load_vehicle("bluerov2_heavy")
PLACED = changed(HEAVY, accelerometer_position=torch.tensor([0.2, -0.1, 0.05], dtype=torch.float64))


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"pose_delay": {"delay": 0.12}, "accelerometer_bias": {"bias_ax": 0.4}},
        {"thruster_lag": {"time_constant": 0.1}},
    ],
    ids=["nominal", "late poses and a bias", "lag"],
)
def test_slopes_of_what_is_felt_are_those_of_the_simulation(values):
    """Moving starts and forces of windows moves what is felt as the tangent says, with a lever arm."""
    (log,) = simulated_logs("bluerov2_heavy", [values], episodes=1, seconds=12.0, felt=0.0)
    windows = cut_windows(log, 2.0, 0.5, 0.2)
    layout, one, rng = Layout.of(windows, PLACED, 0.2), batch(PLACED, [values]), np.random.default_rng(0)
    bins = rng.normal(0, 1, (len(windows), layout.bins, len(layout.dof)))
    state = local_slopes(windows, one, layout, windows.guess, bins)
    move = 1e-4 * rng.normal(size=(len(windows), layout.size))
    start, n = windows.guess.copy(), len(layout.start)
    start[:, layout.start] += move[:, :n]
    pushed = bins + move[:, n:].reshape(bins.shape)
    simulated, _ = flown(actuate(windows, one), layout, start[:, None], pushed[:, None])
    np.testing.assert_allclose(simulated[:, 0], state.residual - (state.slope @ move[..., None])[..., 0], atol=1e-5)


def test_the_engine_predicts_what_a_simulator_logs():
    """Along the very motion of a log without noise, what is felt is as logged."""
    (log,) = simulated_logs("bluerov2_heavy", [{}], episodes=1, seconds=12.0, noise=(0.0, 0.0), felt=0.0)
    windows = cut_windows(log, 2.0, 0.5, 0.2)
    one = batch(HEAVY, [{}])
    predicted, _ = fly(actuate(windows, one), log.episodes[0].values[np.newaxis, windows.start, :12].swapaxes(0, 1))
    left = windows.residual(predicted)[:, 0][..., windows.specific_force]
    seen = windows.trust[..., windows.specific_force] > 0
    assert np.abs(left[seen]).max() < 2e-3  # m/s^2, of 9.8 and of accelerations up to 1


def pushed(values, sets, seed=0, seconds=16.0):
    """Logs of one flight of a Heavy, changed by ``values`` and flown level by a pilot, with some channels each."""
    demand = np.zeros((4, round(seconds / CONTROL_DT), 6))
    demand[..., [0, 1, 2, 5]] = [waves(np.random.default_rng(seed + e), demand.shape[1], 4, 0.1) for e in range(4)]
    (log,) = simulated_logs(
        "bluerov2_heavy", [values], seconds=seconds, episodes=4, felt=0.02, demand=demand, seed=seed
    )
    return [restricted(log, axes) for axes in sets]


@pytest.mark.thorough
def test_a_bias_is_named_with_its_axis_and_value():
    """An accelerometer that reads 0.5 m/s^2 too much, beside stock sensors: its axis, its value, what to do."""
    (log,) = pushed({"accelerometer_bias": {"bias_ax": 0.5}}, [STOCK + FELT])
    found = diagnose(log, HEAVY)
    assert found.verdict is Verdict.EXPLAINED
    (named,) = found.effects
    assert (named.name, set(named.parameters)) == ("accelerometer_bias", {"bias_ax"})
    bias = named.parameters["bias_ax"]
    assert abs(bias.value - 0.5) < 0.05 and bias.high - bias.low < 0.1
    assert any("calibrate the accelerometer" in advice.do for advice in named.advice)


@pytest.mark.thorough
def test_what_a_calibration_leaves_is_no_fault():
    """Half a hundredth of the weight in each axis is slack: no gap."""
    (log,) = pushed({"accelerometer_bias": {"bias_ax": 0.05, "bias_ay": -0.06, "bias_az": 0.05}}, [STOCK + FELT])
    assert diagnose(log, HEAVY).verdict is Verdict.NO_GAP


@pytest.mark.thorough
def test_surge_is_seen_by_what_is_felt_alone():
    """Two horizontal thrusters that lost thrust together turn nothing: stock sensors are blind, felt surge is not."""
    both = {"thruster_gain": {"gain_1": 0.5, "gain_2": 0.5}}
    with_felt, stock = pushed(both, [STOCK + FELT, STOCK])
    few = replace(load_settings(), ignored=tuple(name for name in EFFECTS if name != "thruster_gain"))
    felt, blind = diagnose(with_felt, HEAVY), diagnose(stock, HEAVY, settings=few)
    assert any("surge, sway are not measured" in sentence for sentence in blind.cannot_tell)
    (named,) = felt.effects
    assert named.name == "thruster_gain" and named.thrusters == (1, 2)
    assert all(abs(p.value - 0.5) < 0.1 for p in named.parameters.values())


def test_without_roll_and_pitch_it_is_left_out():
    """A degree of tilt is as much as a push: where the attitude is not logged, a finding says so."""
    (log,) = pushed({}, [("x", "y", "z", "yaw", *FELT)])
    kept = followable(log)
    assert kept.axes == ("x", "y", "z", "yaw") and kept.findings[-1].code == "axes_not_followed"
    assert kept.findings[-1].columns == FELT
