"""Small effects beside large ones, and values that nearly make up for each other."""

import numpy as np
import pytest
from flown_logs import as_read, fly, hold

from auv_torchrl.diagnosis import diagnose
from auv_torchrl.diagnosis.identify.explanation import Explanation, Term
from auv_torchrl.diagnosis.identify.fit import fit_by_simulation, reassess
from auv_torchrl.diagnosis.identify.following import follow_windows, some_diverged
from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.vehicle import load_vehicle
from benchmarks.blind.flights.cases import Case
from benchmarks.blind.flights.fly import fly as sealed_flights
from benchmarks.blind.flights.sensor_sets import sensor_set
from benchmarks.owners.acts import ACTS

PAPER = load_vehicle("paper")
HELD = hold(PAPER)
SETTINGS = load_settings()
COUPLING = {"drag_coupling": {"drag_yaw_from_surge": -4.9}}


def followed(log):
    """A problem of a flight, and its windows followed."""
    return follow_windows(
        Problem.of(cut_windows(log, SETTINGS.window_s, SETTINGS.lead_s, SETTINGS.bin_s), HELD, SETTINGS)
    )


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("number", "effects"), [(21, ("linear_drag", "drag_coupling")), (61, ("thrust_curve", "linear_drag"))]
)
def test_a_drag_that_the_assumed_floor_could_hide_is_named_beside_a_strong_effect(number, effects):
    """A drag that leaves less than the disturbance that may act, but far more than chance, is named with its value."""
    ((log, label),) = sealed_flights([Case(number, "pair", effects, plant="mujoco")], PAPER, 20261212)
    found = {effect.name: effect.parameters for effect in diagnose(log, PAPER).effects}
    assert set(found) == set(effects)
    for member, value in label["values"]["linear_drag"].items():
        assert found["linear_drag"][member].value == pytest.approx(value, rel=0.03)


@pytest.mark.thorough
def test_nothing_is_named_beside_a_coupling_that_says_all():
    """Where one effect acts alone, none is found in what the disturbance could have hidden."""
    assert [effect.name for effect in diagnose(fly(HELD, COUPLING, seed=31), PAPER).effects] == ["drag_coupling"]


@pytest.mark.thorough
def test_a_steep_thrust_curve_is_found_beside_a_wide_dead_band():
    """Another exponent with another dead band lets the same commands through; no limit is named to make up for that."""
    values = {"thrust_curve": {"exponent": 1.75, "asymmetry": 0.34}, "dead_band": {"width": 9.0}}
    effects = diagnose(fly(HELD, values, seed=33), PAPER).effects
    found = {effect.name: {name: e.value for name, e in effect.parameters.items()} for effect in effects}
    assert found == {name: pytest.approx(row, rel=0.03) for name, row in values.items()}


@pytest.mark.thorough
def test_a_tether_is_told_as_surely_as_the_log_tells_it():
    """A longer tether from further away pulls about the same; fits from both sides meet near the truth."""
    case = Case(183, "single_slack", ("tether",), plant="mujoco", slack=0.03)
    ((log, label),) = sealed_flights([case], PAPER, 20261212)
    true = label["values"]["tether"]
    problem, follow = followed(log)
    ends = []
    for longer in (-0.25, 0.25):  # m
        moved = {name: true[name] / np.hypot(true["north"], true["east"]) * longer for name in ("north", "east")}
        begin = {**true, "slack": true["slack"] + longer, **{name: true[name] + by for name, by in moved.items()}}
        terms = tuple(Term("tether", (name,), value) for name, value in begin.items())
        ends.append(fit_by_simulation(problem, Explanation(terms), follow))
    assert ends[0].chi2 == pytest.approx(ends[1].chi2, abs=1.0)
    for fitted in ends:
        off = [term.value - true[term.members[0]] for term in fitted.explanation.terms]
        assert (np.abs(off) < 2.5 * np.sqrt(np.diag(fitted.covariance))).all()


def test_no_window_is_lost_where_an_explanation_is_weighed_again(monkeypatch):
    """A window that flies off when its start is settled under another noise is followed anew."""
    problem, follow = followed(fly(HELD, COUPLING, seed=31, episodes=3, seconds=20.0))
    coupling = Explanation((Term("drag_coupling", ("drag_yaw_from_surge",), -4.9),))
    fit = fit_by_simulation(problem, coupling, follow)
    module = __import__(reassess.__module__, fromlist=["nudge"])
    nudged = module.nudge

    def flown_off(*given):
        path = nudged(*given)
        path.state.residual[0] = np.nan
        return path

    monkeypatch.setattr(module, "nudge", flown_off)
    assert some_diverged(problem, flown_off(problem, coupling, fit.path))
    assert reassess(problem, fit).chi2 == pytest.approx(fit.chi2, abs=5.0)


@pytest.mark.thorough
def test_nothing_small_is_named_of_sound_thrusters_beside_one_that_creeps():
    """Chi-square is rough where commands leave a dead band: neutrals of sound thrusters settle on its dents."""
    heavy, axes = load_vehicle("bluerov2_heavy"), sensor_set("stock").axes
    creeping = Case(1, "thruster", outside="creeping", sensors="stock", axes=axes)
    ((log, label),) = sealed_flights([creeping], heavy, 100, ACTS)
    (effect,) = diagnose(as_read(log, heavy), heavy).effects
    assert effect.name == "neutral_offset" and set(effect.parameters) == {f"offset_{label['drawn']['thruster']}"}
