"""What a reader is told of the effects that were found."""

from dataclasses import make_dataclass
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from auv_torchrl.diagnosis.conclude import decision
from auv_torchrl.diagnosis.conclude.decision import found_effects, is_ordinary
from auv_torchrl.diagnosis.identify.explanation import Explanation, Term
from auv_torchrl.diagnosis.thresholds import MODEL_ERROR, Z95
from auv_torchrl.diagnosis.validate import veto
from auv_torchrl.diagnosis.verdict import Estimate, FoundEffect
from auv_torchrl.flightlog.log import SampleErrors
from auv_torchrl.vehicle import load_vehicle

PAPER = load_vehicle("paper")


@pytest.fixture
def named_effect(monkeypatch):
    """The one effect named, for its probability, where all thrusters are at 0.8 and number 2 at 0.5 besides."""
    everyone = tuple(f"gain_{i}" for i in range(1, 7))
    terms = Term("thruster_gain", everyone, 0.8), Term("thruster_gain", ("gain_2",), 0.5)
    covariance = np.array([[0.01**2, -0.5e-4], [-0.5e-4, 0.02**2]])
    best = SimpleNamespace(explanation=Explanation(terms), covariance=covariance, chi2=100.0)
    found: Any = SimpleNamespace(best=best, none=SimpleNamespace(chi2=1000.0), fits=())
    exact = SimpleNamespace(errors=SampleErrors())
    problem: Any = SimpleNamespace(vehicle=PAPER, known=None, windows=exact)
    monkeypatch.setattr(decision, "as_sure", lambda _, fit: (fit.explanation, fit.covariance))
    return lambda probability, closed=1.0: found_effects(problem, found, {"thruster_gain": probability}, closed, {})[0]


def test_a_thruster_that_two_values_move_has_their_sum_and_one_interval(named_effect):
    """It makes 0.3 of number 2, as doubtful as both values together."""
    effect = named_effect(0.9)
    gains = {name: estimate.value for name, estimate in effect.parameters.items()}
    assert gains == pytest.approx({f"gain_{i}": 0.3 if i == 2 else 0.8 for i in range(1, 7)})
    second = effect.parameters["gain_2"]
    deviation = np.sqrt(0.01**2 + 0.02**2 - 2 * 0.5e-4)
    assert second.high - second.value == pytest.approx(Z95 * np.hypot(deviation, MODEL_ERROR * 0.7))
    assert effect.sentence.count("thruster 2") == 1


def test_an_effect_has_no_share_of_a_gap_that_has_no_size(named_effect):
    """Where the simulator diverges without the effects, nobody knows how much one of them closes."""
    assert named_effect(0.9).gap_closed == pytest.approx(1.0)
    assert named_effect(0.9, None).gap_closed is None


@pytest.mark.parametrize("probability", (0.9, 0.4))
def test_an_owner_is_told_what_to_do_about_each_thruster(named_effect, probability):
    """A repair is known whatever the probability, which is said with it (``report.wording.to_do``)."""
    advice = named_effect(probability).advice
    assert [f"thruster {i + 1}" in one.do for i, one in enumerate(advice)] == [True] * 6


def test_what_leaves_more_than_nothing_does_is_not_found(monkeypatch):
    """Where what is left leaves more than no effect does, none is named; and it closes nothing."""
    kind = make_dataclass("Found", ["best", "none", "fits"])
    better, worse, none = (SimpleNamespace(explanation=Explanation(terms=(Term("buoyancy", ("force",), 3.0),)), chi2=c)
                           for c in (50.0, 3e7, 3e6))  # fmt: skip
    steps = iter([kind(worse, none, ()), None])
    monkeypatch.setattr(veto, "_without_one", lambda *_: next(steps))
    found = veto.take_back(cast(Any, kind(better, none, ())), cast(Any, None), cast(Any, None))
    assert found.best is none
    assert decision.leave_one_out(cast(Any, kind(worse, none, ()))) == {"buoyancy": 0.0}


def test_what_every_vehicle_is_off_by_is_no_finding_beside_a_fault():
    """In logs that vehicles write, whose clocks and filters are off; not where what is logged is exact."""

    def ordinary(name, member, value, errors):
        problem = SimpleNamespace(vehicle=load_vehicle("paper"), windows=SimpleNamespace(errors=errors))
        effect = FoundEffect(name, 1.0, {member: Estimate(value, value, value, 0.0, "")}, (), None, "")
        return is_ordinary(cast(Any, problem), effect)

    written = SampleErrors(snapshot_s=0.1)
    assert ordinary("command_delay", "delay", 0.0046, written) and ordinary("gyro_bias", "bias_r", -0.002, written)
    assert not ordinary("command_delay", "delay", 0.0046, SampleErrors())
    assert not ordinary("command_delay", "delay", 0.05, written) and not ordinary("buoyancy", "force", 0.1, written)


@pytest.mark.parametrize(
    ("value", "low", "high", "nominal", "departs"),
    [(0.0, 0.0, 0.03, 0.0, False), (0.0004, 0.0, 0.0325, 0.0, False), (0.55, 0.54, 0.56, 1.0, True)]
    + [(2.0, 2.0, 2.0, 1.0, True), (1.0, 1.0, 1.0, 1.0, False), (0.1, -np.inf, np.inf, 0.0, True)],
)
def test_what_is_written_as_nominal_is_no_finding(value, low, high, nominal, departs):
    """An effect of which every value is nominal to the digits that its interval leaves is not listed."""
    found = FoundEffect("command_delay", 1.0, {"delay": Estimate(value, low, high, nominal, "s")}, (), None, "")
    assert found.departs is departs
