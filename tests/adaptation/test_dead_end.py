"""When a map leads nowhere."""

import numpy as np
import pytest

from auv_torchrl.adaptation import load_adaptation_config
from auv_torchrl.adaptation.detector import DeadEnd

LIMITS = (-np.ones(6), np.ones(6))


def first(share, velocity, seconds=5.0):
    """When one vehicle with constant thrusts and velocity is found in a dead end, s; infinite if never."""
    dead_end = DeadEnd(1, LIMITS, 0.05, load_adaptation_config())
    for k in range(round(seconds / 0.05)):
        if dead_end.reached(np.array([share]), np.array([velocity]))[0]:
            return 0.05 * (k + 1)
    return np.inf


FULL = (1.0, -1.0, 1.0, -1.0, 1.0, -1.0)


@pytest.mark.parametrize("share", [FULL, (1.0, -1.0, -1.0, -1.0, 0.1, 0.1)])
@pytest.mark.parametrize("velocity", [(0.1, 0.0, 0.0, 0.0), (0.3, 0.2, 0.0, -2.7)])
def test_pushing_without_getting_anywhere_is_a_dead_end(share, velocity):
    """All or all horizontal thrusters at their limits, and hardly any speed or a whole turn: found within 3 s."""
    assert 1.0 < first(share, velocity) < 3.0


@pytest.mark.parametrize(
    ("share", "velocity"),
    [
        (FULL, (0.5, 0.0, 0.0, 0.3)),  # under way
        ((1.0, 0.2, 0.0, 0.0, 0.1, 0.1), (0.0, 0.0, 0.0, 0.0)),  # one weak thruster helps to hold the place
        (FULL, (np.nan, 0.0, 0.0, np.nan)),  # not known
    ],
)
def test_travel_holding_and_unknown_motion_are_none(share, velocity):
    """A vehicle under way, one that holds its place and one whose speed is not known are left alone."""
    assert first(share, velocity) == np.inf
