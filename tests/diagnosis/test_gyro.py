"""A gyro that is off, beside an attitude that is not."""

import pytest

from auv_torchrl.diagnosis import Verdict, diagnose
from auv_torchrl.diagnosis.axes import restricted
from auv_torchrl.vehicle import load_vehicle
from tests.flightlog.simulate import simulated_logs

PAPER = load_vehicle("paper")
STOCK = ("z", "roll", "pitch", "yaw", "p", "q", "r")


@pytest.fixture(scope="module")
def log():
    """What a sound vehicle with a biased gyro reports, in all channels."""
    (log,) = simulated_logs("paper", [{"gyro_bias": {"bias_q": 0.03}}], episodes=3, seconds=16.0, seed=1)
    return log


def test_a_biased_gyro_is_named_with_its_bias(log):
    """Attitudes that do not turn as the gyro says: its offset in its axis, and what to do about it."""
    found = diagnose(restricted(log, STOCK), PAPER)
    assert found.verdict is Verdict.EXPLAINED
    (named,) = found.effects
    assert (named.name, set(named.parameters)) == ("gyro_bias", {"bias_q"})
    bias = named.parameters["bias_q"]
    assert bias.low <= 0.03 <= bias.high and bias.high - bias.low < 0.004
    assert any("calibrate the gyro" in advice.do for advice in named.advice)


def test_without_a_gyro_the_log_says_that_it_cannot_tell(log):
    """A pose alone shows no mark of it."""
    found = diagnose(restricted(log, ("x", "y", "z", "yaw")), PAPER)
    assert found.verdict is Verdict.NO_GAP
    assert "gyro_bias would leave no mark on this log" in found.cannot_tell
