"""Known vehicles are flown and diagnosed."""

import numpy as np
import pytest
from flown_logs import fly, hold, with_slack

from auv_torchrl.diagnosis import Verdict, diagnose
from auv_torchrl.vehicle import load_vehicle

PAPER = load_vehicle("paper")
HELD = hold(PAPER)
SHORT = {"episodes": 3, "seconds": 20.0}


def test_a_weak_thruster_is_named_with_its_gain():
    """A thruster at 40 % is found, its gain lies in the interval and the gap closes."""
    diagnosis = diagnose(fly(HELD, {"thruster_gain": {"gain_2": 0.4}}, seed=1, **SHORT), PAPER)
    assert diagnosis.verdict is Verdict.EXPLAINED
    (effect,) = diagnosis.effects
    assert (effect.name, effect.thrusters) == ("thruster_gain", (2,))
    gain = effect.parameters["gain_2"]
    assert gain.low < 0.4 < gain.high
    assert abs(gain.value - 0.4) < 0.03
    assert diagnosis.gap.closed is not None and diagnosis.gap.closed > 0.9
    assert diagnosis.where.thruster["2"] == pytest.approx(1.0)


def test_slack_alone_is_no_gap():
    """A vehicle whose coefficients are all a few percent off has no gap, and the log says what it could have shown."""
    vehicle = with_slack(HELD, np.random.default_rng(3))
    diagnosis = diagnose(fly(vehicle, {}, seed=2, **SHORT), PAPER)
    assert diagnosis.verdict is Verdict.NO_GAP
    assert diagnosis.effects == ()
    assert {"buoyancy", "thruster_lag"} <= set(diagnosis.detectable)


@pytest.mark.thorough
@pytest.mark.slow
def test_an_effect_that_is_not_known_is_not_explained():
    """Thrusters that follow large changes of their command only are not taken for a known effect."""
    last: dict[str, np.ndarray] = {}

    def play(commands, position, velocity, t):
        held = commands if t == 0 else np.clip(last["y"], commands - 0.1, commands + 0.1)
        last["y"] = held
        return held, np.zeros_like(position)

    diagnosis = diagnose(fly(HELD, {}, seed=4, push=play, **SHORT), PAPER)
    assert diagnosis.verdict in (Verdict.PARTLY_EXPLAINED, Verdict.UNEXPLAINED)
    assert max(diagnosis.candidates, key=lambda candidate: candidate.probability).name == "unknown"
