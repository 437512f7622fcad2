"""Small effects beside large ones, and values that nearly make up for each other."""

import numpy as np
import pytest
from flown_logs import fly, hold

from auv_torchrl.diagnosis import diagnose
from auv_torchrl.diagnosis.identify.explanation import Explanation, Knob
from auv_torchrl.diagnosis.identify.fit import fit_by_simulation, reassess
from auv_torchrl.diagnosis.identify.following import follow_windows, some_diverged
from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.vehicle import load_vehicle

PAPER = load_vehicle("paper")
HELD = hold(PAPER)
SETTINGS = load_settings()
COUPLING = {"drag_coupling": {"drag_yaw_from_surge": -4.9}}


def followed(values, seed, **how):
    """A problem of a flight of the vehicle changed by values, and its windows followed."""
    log = fly(HELD, values, seed=seed, **how)
    return follow_windows(
        Problem.of(cut_windows(log, SETTINGS.window_s, SETTINGS.lead_s, SETTINGS.bin_s), HELD, SETTINGS)
    )


def test_a_drag_that_the_assumed_floor_could_hide_is_named_beside_a_strong_coupling():
    """A yaw drag of 1.7 leaves less than the disturbance that may act, but far more than chance; both are named."""
    values = {**COUPLING, "linear_drag": {"scale_yaw": 1.7}}
    effects = diagnose(fly(HELD, values, seed=31), PAPER).effects
    found = {effect.name: {name: e.value for name, e in effect.parameters.items()} for effect in effects}
    assert found == {name: pytest.approx(row, rel=0.05) for name, row in values.items()}


def test_nothing_is_named_beside_a_coupling_that_says_all():
    """Where one effect acts alone, none is found in what the disturbance could have hidden."""
    assert [effect.name for effect in diagnose(fly(HELD, COUPLING, seed=31), PAPER).effects] == ["drag_coupling"]


def test_a_steep_thrust_curve_is_found_beside_a_wide_dead_band():
    """Another exponent with another dead band lets the same commands through; no limit is named to make up for that."""
    values = {"thrust_curve": {"exponent": 1.75, "asymmetry": 0.34}, "dead_band": {"width": 9.0}}
    effects = diagnose(fly(HELD, values, seed=33), PAPER).effects
    found = {effect.name: {name: e.value for name, e in effect.parameters.items()} for effect in effects}
    assert found == {name: pytest.approx(row, rel=0.03) for name, row in values.items()}


def test_a_tether_is_told_as_surely_as_the_log_tells_it():
    """A longer tether from further away pulls about the same; fits from both sides meet, intervals hold it."""
    true = {"north": 3.6, "east": 3.8, "down": -0.8, "stiffness": 15.0, "slack": 4.7}
    problem, follow = followed({"tether": true}, seed=34)
    ends = []
    for longer in (0.95, 1.05):
        begin = {**true, "north": 3.6 * longer, "east": 3.8 * longer, "slack": 4.7 + 5.3 * (longer - 1)}
        knobs = tuple(Knob("tether", (name,), value) for name, value in begin.items())
        ends.append(fit_by_simulation(problem, Explanation(knobs), follow))
    assert ends[0].chi2 == pytest.approx(ends[1].chi2, abs=1.0)
    for fitted in ends:
        sure = np.sqrt(np.diag(fitted.covariance))
        off = np.array([knob.value - true[knob.members[0]] for knob in fitted.explanation.knobs])
        assert (np.abs(off) < 3 * sure).all()
        assert sure[0] < 0.3


def test_no_window_is_lost_where_an_explanation_is_weighed_again(monkeypatch):
    """A window that flies off when its start is settled under another noise is followed anew."""
    problem, follow = followed(COUPLING, seed=31, episodes=3, seconds=20.0)
    coupling = Explanation((Knob("drag_coupling", ("drag_yaw_from_surge",), -4.9),))
    judged = fit_by_simulation(problem, coupling, follow)
    module = __import__(reassess.__module__, fromlist=["nudge"])
    nudged = module.nudge

    def flown_off(*given):
        base = nudged(*given)
        base.state.residual[0] = np.nan
        return base

    monkeypatch.setattr(module, "nudge", flown_off)
    assert some_diverged(problem, flown_off(problem, coupling, judged.base))
    assert reassess(problem, judged).chi2 == pytest.approx(judged.chi2, abs=5.0)
