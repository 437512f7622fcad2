"""Small changes of windows against simulations of them."""

import numpy as np
import pytest
import torch
from flown_logs import AXES, fly, hold

from auv_torchrl.diagnosis.identify.hypotheses import batch
from auv_torchrl.diagnosis.motion.actuation import actuate
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.motion.smooth import Layout, flown, local_slopes
from auv_torchrl.effects.effect import changed
from auv_torchrl.vehicle import load_vehicle

EFFECTS = {
    "nominal": {},
    "late commands and lag": {"command_delay": {"delay": 0.13}, "thruster_lag": {"time_constant": 0.1}},
    "late poses, biased heading": {"pose_delay": {"delay": 0.12}, "heading_bias": {"angle": 0.3}},
    "scaled and biased sensors": {
        "position_scale": {"factor": 1.2},
        "depth_scale": {"factor": -0.8},
        "depth_bias": {"offset": 0.3},
        "velocity_scale": {"factor": 0.9},
        "gyro_bias": {"bias_r": 0.05},
        "accelerometer_bias": {"bias_ax": 0.4},
        "heading_bias": {"angle": 2.0},
        "compass_interference": {"angle": 0.4},
    },
    "turned Doppler log off the origin": {"velocity_scale": {"factor": 0.9}},
}
MOUNTED = {"dvl_turn": torch.tensor(1.2), "dvl_position": torch.tensor([0.3, -0.2, 0.1])}
LOGS = {"pose": AXES, "pose and velocity": (*AXES, "u", "v", "w", "r"), "no position": ("z", "yaw", "u", "v", "w", "r")}


@pytest.mark.parametrize("held", [True, False], ids=["level", "free"])
@pytest.mark.parametrize("name", EFFECTS)
@pytest.mark.parametrize("axes", LOGS.values(), ids=LOGS)
def test_slopes_are_those_of_the_simulation(name, held, axes):
    """Moving the starts and forces of windows moves their samples as the tangent says, to second order."""
    vehicle = changed(load_vehicle("paper"), **(MOUNTED if "Doppler" in name else {}))
    vehicle = hold(vehicle) if held else vehicle
    windows = cut_windows(fly(vehicle, EFFECTS[name], episodes=1, seconds=12.0, axes=axes), 2.0, 0.5, 0.2)
    layout = Layout.of(windows, vehicle, 0.2)
    one = batch(vehicle, [EFFECTS[name]])
    rng = np.random.default_rng(0)
    bins = rng.normal(0, 1, (len(windows), layout.bins, len(layout.dof)))
    state = local_slopes(windows, one, layout, windows.guess, bins)
    move = 1e-4 * rng.normal(size=(len(windows), layout.size))
    start, n = windows.guess.copy(), len(layout.start)
    start[:, layout.start] += move[:, :n]
    pushed = bins + move[:, n:].reshape(bins.shape)
    simulated, _ = flown(actuate(windows, one), layout, start[:, None], pushed[:, None])
    np.testing.assert_allclose(simulated[:, 0], state.residual - (state.slope @ move[..., None])[..., 0], atol=2e-6)
