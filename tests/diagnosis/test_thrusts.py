"""What vehicles do with commands: equal thrusters of many vehicles are worked out once."""

import numpy as np
import pytest

from auv_torchrl.diagnosis.identify.hypotheses import batch
from auv_torchrl.diagnosis.motion.actuation import actuate
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.vehicle import load_vehicle
from tests.flightlog.simulate import simulated_logs

VEHICLE = load_vehicle("paper")
ROWS = [
    {},
    {"dead_band": {"width": 1.5}},
    {"thruster_gain": {"gain_2": 0.3}},
    {"thrust_limit": {"limit_1": 5.0}},
    {"command_delay": {"delay": 0.03}},
    {"command_delay": {"delay": 0.12}, "thrust_limit": {"limit_1": 5.0}},
    {"thruster_lag": {"time_constant": 0.2}},
]


@pytest.mark.parametrize("parts", [1, 2])
def test_targets_of_many_vehicles_are_those_of_each(parts):
    """Whatever else is worked out with it, a vehicle calls for the same thrust."""
    (log,) = simulated_logs("paper", [{}], episodes=1, seconds=12.0)
    windows, steps = cut_windows(log, 1.0, 0.5, 0.2), np.arange(5)
    some = slice(0, len(windows))
    for rows in (ROWS[:4], ROWS):
        together = actuate(windows, batch(VEHICLE, rows))
        targets = together.targets(some, steps, parts)
        for place, row in enumerate(rows):
            alone = actuate(windows, batch(VEHICLE, [row]))
            for part, target in enumerate(alone.targets(some, steps, parts)):
                np.testing.assert_allclose(targets[part][:, place], target[:, 0], atol=1e-9)
            if alone.terms.lag:  # others have no thrust from before
                np.testing.assert_allclose(together.thrust[:, place], alone.thrust[:, 0], atol=1e-9)
