"""What a reader is told of the effects that were found."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from auv_torchrl.diagnosis import named
from auv_torchrl.diagnosis.calibrate.coefficients import MODEL_ERROR, Z95
from auv_torchrl.diagnosis.identify.explanation import Explanation, Knob
from auv_torchrl.diagnosis.named import found_effects
from auv_torchrl.vehicle import load_vehicle

PAPER = load_vehicle("paper")


def test_a_thruster_that_two_values_move_has_their_sum_and_one_interval(monkeypatch):
    """All thrusters at 0.8 and number 2 at 0.5 besides make 0.3 of number 2, as doubtful as both together."""
    everyone = tuple(f"gain_{i}" for i in range(1, 7))
    knobs = Knob("thruster_gain", everyone, 0.8), Knob("thruster_gain", ("gain_2",), 0.5)
    covariance = np.array([[0.01**2, -0.5e-4], [-0.5e-4, 0.02**2]])
    best = SimpleNamespace(explanation=Explanation(knobs), covariance=covariance, chi2=100.0)
    found: Any = SimpleNamespace(best=best, none=SimpleNamespace(chi2=1000.0), polished=[])
    problem: Any = SimpleNamespace(vehicle=PAPER)
    monkeypatch.setattr(named, "as_sure", lambda _, judged: (judged.explanation, judged.covariance))
    (effect,) = found_effects(problem, found, {"thruster_gain": 0.9}, 1.0, {})
    gains = {name: estimate.value for name, estimate in effect.parameters.items()}
    assert gains == pytest.approx({**dict.fromkeys(everyone, 0.8), "gain_2": 0.3})
    second = effect.parameters["gain_2"]
    deviation = np.sqrt(0.01**2 + 0.02**2 - 2 * 0.5e-4)
    assert second.high - second.value == pytest.approx(Z95 * np.hypot(deviation, MODEL_ERROR * 0.7))
    assert effect.sentence.count("thruster 2") == 1
    assert ["thruster 2" in advice.do for advice in effect.advice] == [False, True, False, False, False, False]
