"""Several effects at once, vehicles that tilt, and slack: at its limit, or smaller than it may be."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from flown_logs import fly, hold, with_slack
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from auv_torchrl.diagnosis import Verdict, diagnose
from auv_torchrl.diagnosis.identify.explanation import Explanation, Term
from auv_torchrl.diagnosis.identify.fit import fit_along_motion, fit_by_simulation
from auv_torchrl.diagnosis.identify.following import chi2_by_window, follow_windows, hand_on, nudge, path_under
from auv_torchrl.diagnosis.identify.hypotheses import apply_values, load_settings
from auv_torchrl.diagnosis.identify.neighbours import held_at
from auv_torchrl.diagnosis.identify.paths import nuisance_now
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.screen import Field
from auv_torchrl.diagnosis.identify.search import search
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.thresholds import NUISANCE_LIMIT, STUCK
from auv_torchrl.diagnosis.validate.predict import predict
from auv_torchrl.diagnosis.validate.veto import falls_short
from auv_torchrl.effects import EFFECTS
from auv_torchrl.flightlog import read_flightlog, write_columns
from auv_torchrl.sysid.bounded import bounded_minimum
from auv_torchrl.vehicle import load_vehicle
from benchmarks.blind.flights.cases import Case
from benchmarks.blind.flights.fly import fly as sealed_flights
from benchmarks.blind.seal import hand_over

PAPER = load_vehicle("paper")
HELD = hold(PAPER)
SETTINGS = load_settings()
TRIED = ("thruster_gain", "thrust_limit", "linear_drag", "buoyancy", "current")
FEW = replace(SETTINGS, ignored=tuple(name for name in EFFECTS if name not in TRIED))  # where it is not about which
SHORT = {"episodes": 3, "seconds": 20.0}
TETHER = {"north": 6.0, "east": -3.0, "down": -0.5, "stiffness": 12.0, "slack": 5.7}


def problem_of(vehicle, values, seed, nominal=HELD, settings=SETTINGS):
    """A problem of a short flight of a vehicle."""
    log = fly(vehicle, values, seed=seed, **SHORT)
    return Problem.of(cut_windows(log, settings.window_s, settings.lead_s, settings.bin_s), nominal, settings)


def searched(problem, **how):
    """What a search finds: values of terms by effect and first member."""
    found = search(*follow_windows(problem), lambda *_: None, **how)
    return {(term.effect, term.members[0]): term.value for term in found.best.explanation.terms}


@pytest.mark.parametrize(
    "values",
    [
        pytest.param(
            {"thruster_lag": {"time_constant": 0.23}, "tether": TETHER}, id="tether", marks=pytest.mark.thorough
        ),
        pytest.param(
            {"thruster_lag": {"time_constant": 0.2}, "thrust_limit": {f"limit_{i}": 26.0 for i in range(1, 7)}},
            id="limit",
        ),
    ],
)
def test_two_effects_are_found_though_a_third_fits_better_than_either_alone(values):
    """A lag hides what acts beside it, and looks like inertia until that is known; both are named with their values."""
    diagnosis = diagnose(fly(HELD, values, seed=11, **SHORT), PAPER)
    assert diagnosis.verdict is Verdict.EXPLAINED
    assert {effect.name for effect in diagnosis.effects} == set(values)
    (lag,) = (effect for effect in diagnosis.effects if effect.name == "thruster_lag")
    assert lag.parameters["time_constant"].value == pytest.approx(values["thruster_lag"]["time_constant"], rel=0.03)
    for limit in (effect for effect in diagnosis.effects if effect.name == "thrust_limit"):
        assert limit.sentence.startswith("every thruster saturates at")


@pytest.mark.thorough
def test_two_effects_are_found_though_they_tilt_the_vehicle_far():
    """Ballast and an offset centre of mass tilt a vehicle by 70 degrees, where a look along a level motion misleads."""
    values = {"mass_offset": {"x": 0.071, "y": 0.0074}, "buoyancy": {"force": -8.7}}
    found = searched(problem_of(PAPER, values, seed=4, nominal=PAPER))
    assert found == {
        ("mass_offset", "x"): pytest.approx(0.071, abs=0.002),
        ("mass_offset", "y"): pytest.approx(0.0074, abs=0.002),
        ("buoyancy", "force"): pytest.approx(-8.7, abs=0.1),
    }


@pytest.mark.thorough
def test_a_hint_that_needs_slack_at_its_limit_does_not_end_the_search():
    """A drag that fits a weak thruster only with gains at four standard deviations of slack is not taken for it."""
    values = {"quadratic_drag": {"scale_heave": 0.5}, "thruster_gain": {"gain_5": 0.55}}
    hint = Explanation((Term("quadratic_drag", ("scale_heave",), 0.68),))
    found = searched(problem_of(PAPER, values, seed=3, nominal=PAPER), begin=[hint])
    assert found == {
        ("quadratic_drag", "scale_heave"): pytest.approx(0.5, abs=0.05),
        ("thruster_gain", "gain_5"): pytest.approx(0.55, abs=0.03),
    }


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("number", "effects"),
    [
        pytest.param(39, ("current", "tether"), id="dead band"),
        pytest.param(42, ("linear_drag", "drag_coupling"), id="windows that fly off"),
        pytest.param(78, ("battery_sag", "thruster_gain"), id="slack"),
    ],
)
def test_two_effects_are_found_though_fits_end_early(number, effects):
    """Dead bands that a fit came by, two windows that fly off, and slack at its limits hide no effect and add none."""
    case = Case(number, "pair", effects=effects, plant="mujoco" if number % 2 else "foreign")
    ((log, _),) = sealed_flights([case], PAPER, 60317)
    assert {effect.name for effect in diagnose(log, PAPER).effects} == set(effects)


@pytest.mark.thorough
def test_further_effects_are_tried_though_slack_hides_that_one_is_needed():
    """A weak thruster beside ballast, which gains at their limits fit to 3 %, is named though a limit promised more."""
    case = Case(52, "pair", effects=("buoyancy", "thruster_gain"), plant="foreign")
    ((log, _),) = sealed_flights([case], PAPER, 9001)
    assert {effect.name for effect in diagnose(log, PAPER).effects} == set(case.effects)


@pytest.mark.thorough
def test_an_effect_takes_over_what_another_one_did_in_its_place():
    """A steady sinking of the water pushes down like weight; once weight is tried beside it, the water stands still."""
    values = {"buoyancy": {"force": -9.4}, "current": {"north": 0.073, "east": -0.17}}
    diagnosis = diagnose(fly(HELD, values, seed=11, **SHORT), PAPER)
    assert diagnosis.verdict is Verdict.EXPLAINED
    found = {effect.name: {name: e.value for name, e in effect.parameters.items()} for effect in diagnosis.effects}
    assert found == {name: pytest.approx(row, rel=0.02) for name, row in values.items()}


@pytest.mark.thorough
def test_a_healthy_vehicle_is_fitted_as_long_as_what_contends_with_it():
    """A flight in which the first fit of "no gap" stops 200 of chi-square short of its best is still without a gap."""
    ((log, _),) = sealed_flights([Case(4, "no_gap_slack", plant="foreign", slack=0.03)], PAPER, 5150)
    assert diagnose(log, PAPER).verdict is Verdict.NO_GAP


@pytest.mark.thorough
def test_no_gap_is_fitted_though_a_window_diverges_on_the_way():
    """A vehicle with slack alone, whose nominal simulation flies off in one window, has no gap."""
    ((log, _),) = sealed_flights([Case(20, "no_gap_slack", plant="foreign", slack=0.03)], PAPER, 20261122)
    assert diagnose(log, PAPER).verdict is Verdict.NO_GAP


def test_thrusters_that_failed_in_different_ways_are_named_one_by_one():
    """Three thrusters, reversed, weak and dead, are not taken for one value of all of them and something else."""
    gains = {"gain_1": -1.0, "gain_2": 0.2, "gain_4": 0.0}
    (effect,) = diagnose(fly(HELD, {"thruster_gain": gains}, seed=9, **SHORT), PAPER).effects
    assert {name: round(estimate.value, 1) for name, estimate in effect.parameters.items()} == gains


def test_an_effect_is_fitted_though_slack_is_at_its_limit():
    """What slack cannot take goes to the effect that is fitted, sketched along the measured motion or simulated."""
    problem = problem_of(
        HELD, {"thruster_lag": {"time_constant": 0.2}, "payload": {"mass": 4.0, "weight": 8.0}}, seed=3
    )
    problem, follow = follow_windows(problem)
    lag = Explanation((Term("thruster_lag", ("time_constant",), 0.1),))
    sketch, polished = fit_along_motion(problem, lag, follow), fit_by_simulation(problem, lag, follow)
    widths = np.array([width for *_, width in problem.nuisance])
    for fit in (sketch, polished):
        stretch = np.abs(nuisance_now(problem, fit.explanation)) / widths
        assert stretch.max() == pytest.approx(NUISANCE_LIMIT)
        assert fit.explanation.terms[0].value == pytest.approx(0.2, rel=0.25)


def test_a_value_is_said_that_slack_is_stretched_for():
    """Of a current, both numbers: beside slack that has nearly all of one, a sketch promises nothing of it."""
    problem = problem_of(HELD, {"current": {"north": 0.15, "east": -0.1}}, seed=3, settings=FEW)
    nuisance = (*problem.nuisance, *(("current", axis, 0.0, 0.02) for axis in ("north", "east")))
    covariance = np.diag([width**2 for *_, width in nuisance])
    problem = replace(
        problem, nuisance=nuisance, nuisance_covariance=covariance, nuisance_precision=np.linalg.inv(covariance)
    )
    problem, follow = follow_windows(problem)
    north = fit_by_simulation(problem, Explanation((Term("current", ("north",), 0.15),)), follow)
    assert north.explanation.nuisance["current", "east"] == pytest.approx(-0.02 * NUISANCE_LIMIT)
    best = search(problem, follow, lambda *_: None, [north.explanation.alone]).best.explanation
    assert best.values(HELD)["current"] == pytest.approx({"north": 0.15, "east": -0.1}, abs=0.01)
    assert best.effects == ("current",) and len(best.terms) == 2


def test_a_thrust_curve_is_fitted_together_with_the_dead_band():
    """A flatter curve with a wider dead band lets the same commands through; fits that begin there come back."""
    problem = problem_of(HELD, {"thrust_curve": {"exponent": 1.56}, "buoyancy": {"force": -9.5}}, seed=4)
    ((key, width),) = (
        ((effect, member), width) for effect, member, _, width in problem.nuisance if effect == "dead_band"
    )
    (problem, follow), found = follow_windows(problem), []
    for exponent, of_width in ((1.585, -0.8), (1.56, 0.0), (1.53, 0.8)):
        terms = Term("thrust_curve", ("exponent",), exponent), Term("buoyancy", ("force",), -9.5)
        fitted = fit_by_simulation(problem, Explanation(terms, {key: of_width * width}), follow)
        assert fitted.nothing_left
        found.append(fitted.explanation.terms[0].value)
    assert found == pytest.approx([1.56] * 3, abs=0.005)
    assert np.ptp(found) < 0.004


def test_a_window_that_has_lost_its_start_finds_it_again():
    """A first window that begins with a wrong spin, from which it never settles, ends like the others."""
    problem = problem_of(with_slack(HELD, np.random.default_rng(1)), {}, seed=4)
    problem, follow = follow_windows(problem)
    sound = path_under(problem, Explanation(), follow)
    start = sound.state.start.copy()
    first = problem.windows.start == problem.windows.start.min()
    start[first, 11] += 8.0
    astray = nudge(problem, sound.explanation, replace(sound, state=replace(sound.state, start=start)))
    assert np.abs(astray.state.start[first, 11] - sound.state.start[first, 11]).max() > 1.0
    found = hand_on(problem, astray)
    np.testing.assert_allclose(found.state.start[:, 11], sound.state.start[:, 11], atol=0.05)


def test_a_lost_window_begins_where_the_one_before_it_ends_although_that_misses_something_too():
    """A load that no window knows of; beside that, a wrong spin stands out, and its free start was no better."""
    problem, follow = follow_windows(problem_of(HELD, {"buoyancy": {"force": 2.0}}, seed=4))
    sound = path_under(problem, Explanation(), follow)
    left = chi2_by_window(problem, sound.state) / problem.windows.numbers_of_each
    lost = int(np.flatnonzero((problem.windows.start[1:] > problem.windows.start.min()) & (left[:-1] > STUCK))[0]) + 1
    start = sound.state.start.copy()
    start[lost, 11] += 8.0
    problem = replace(problem, seen_start=start)
    astray = nudge(problem, sound.explanation, replace(sound, state=replace(sound.state, start=start)))
    assert np.abs(astray.state.start - sound.state.start)[lost, 11] > 1.0
    found = hand_on(problem, astray)
    np.testing.assert_allclose(found.state.start[:, 11], sound.state.start[:, 11], atol=0.1)


def test_a_coefficient_that_is_far_off_by_chance_is_no_effect():
    """One thruster 3.3 standard deviations stronger, as one vehicle in fifty has it, is still slack."""
    vehicle = with_slack(HELD, np.random.default_rng(5))
    vehicle.gain[1] = 1.1
    assert diagnose(fly(vehicle, {}, seed=6, **SHORT), PAPER).verdict is Verdict.NO_GAP


def test_what_fits_the_log_but_not_held_out_flight_does_not_explain_it():
    """An effect at half its size closes half of the gap in held-out flight: that falls short, the whole effect not."""
    test = fly(HELD, {"buoyancy": {"force": 8.0}}, seed=8, episodes=1, seconds=20.0)
    half, whole = (apply_values(HELD, {"buoyancy": {"force": force}}) for force in (4.0, 8.0))
    noise = {"x": 0.002, "y": 0.002, "z": 0.002, "yaw": 0.004}
    floor = 4 * np.array(SETTINGS.floor_force)[[0, 1, 2, 5]]
    p = predict(test, [HELD, half, whole], SETTINGS, noise, floor)
    errors = [float(np.abs(p.error[:, v, :, 2]).mean()) for v in range(3)]
    assert errors[1] == pytest.approx(0.5 * errors[0], rel=0.2)
    assert not falls_short(p, 0.99)
    assert not falls_short(p, 0.5), "the last vehicle is at the floor"
    p = predict(test, [HELD, whole, half], SETTINGS, noise, floor)
    assert falls_short(p, 0.5)


@given(st.integers(1, 8), st.integers(0, 2**32 - 1))
def test_a_bounded_minimum_is_where_a_solver_finds_it(count, seed):
    """Numbers stay within their bounds, and where the bounds are wide they are the least squares solution."""
    rng = np.random.default_rng(seed)
    rows = rng.standard_normal((count + 3, count))
    aim = rng.standard_normal(count + 3)
    H, g = rows.T @ rows, rows.T @ aim
    np.testing.assert_allclose(bounded_minimum(H, g, -np.full(count, 1e9), np.full(count, 1e9)), np.linalg.solve(H, g))
    diagonal = np.diag(np.diag(H))
    least = bounded_minimum(diagonal, g, -0.1 * np.ones(count), 0.2 * np.ones(count))
    solved = lsq_linear(np.sqrt(diagonal), g / np.sqrt(np.diag(H)), (-0.1, 0.2))
    np.testing.assert_allclose(least, solved.x, atol=1e-6)


def test_of_many_windows_some_are_searched_and_what_is_found_is_fitted_to_all(monkeypatch):
    """A long log is searched in windows spread over it; the fault found there is fitted to all of them."""
    problem, follow = follow_windows(problem_of(HELD, {"thruster_gain": {"gain_4": 0.55}}, seed=5, settings=FEW))
    whole = search(problem, follow, lambda *_: None)
    screen, looked_at = Field.of, []

    def counted(problem, *how):
        looked_at.append(len(problem.windows))
        return screen(problem, *how)

    module = sys.modules[search.__module__]
    monkeypatch.setattr(module, "MANY_WINDOWS", 10)
    monkeypatch.setattr(module, "SEARCHED_WINDOWS", 8)
    monkeypatch.setattr(Field, "of", counted)
    found = search(problem, follow, lambda *_: None)
    assert len(problem.windows) > 10
    assert looked_at[0] == 8 and looked_at[-1] == len(problem.windows)
    assert found.best.quadratic.numbers == found.none.quadratic.numbers == whole.best.quadratic.numbers
    (term,), (same,) = found.best.explanation.terms, whole.best.explanation.terms
    assert term.key == same.key == ("thruster_gain", ("gain_4",))
    assert term.value == pytest.approx(same.value, rel=0.01)


@pytest.mark.parametrize("seed", [2, pytest.param(4, marks=pytest.mark.thorough)])
def test_a_fit_ends_at_the_same_dead_band_wherever_it_begins(seed):
    """The slack of a threshold, in which chi-square is rough, is found from two standard deviations to either side."""
    vehicle = with_slack(HELD, np.random.default_rng(seed))
    problem, follow = follow_windows(problem_of(vehicle, {"buoyancy": {"force": 6.0}}, seed=seed))
    dead_band = next(parameter for parameter in problem.nuisance if problem.settings.is_rough(parameter[0]))
    ends = []
    for deviation in (-2, -1, 0, 1, 2):
        begin = Explanation((Term("buoyancy", ("force",), 5.5),), {dead_band[:2]: deviation * dead_band[3]})
        ends.append(fit_by_simulation(problem, begin, follow).chi2)
    assert max(ends) - min(ends) < 1.0


def test_slack_is_asked_before_a_value_is_believed():
    """By its quadratic a fit loses nothing without a value that slack can take, and much without one that it cannot."""
    problem, follow = follow_windows(problem_of(with_slack(HELD, np.random.default_rng(1)), {}, seed=4))
    off = Explanation((Term("added_mass", ("scale_heave",), 1.04),))
    fit = fit_by_simulation(problem, off, follow)
    moved, rise = held_at(problem, fit, {0: 1.0})
    assert rise < 10
    nothing = fit_by_simulation(problem, Explanation(nuisance=moved.nuisance), fit.path)
    assert nothing.evidence > fit.evidence
    problem, follow = follow_windows(problem_of(HELD, {"thruster_gain": {"gain_2": 0.5}}, seed=4))
    fit = fit_by_simulation(problem, Explanation((Term("thruster_gain", ("gain_2",), 0.6),)), follow)
    assert held_at(problem, fit, {0: 1.0})[1] > 100


def test_what_a_fit_would_still_gain_does_not_speak_for_fewer_values():
    """A value that slack cannot take stays, though a fit that stopped early would gain more than the value is worth."""
    vehicle = with_slack(HELD, np.random.default_rng(1))
    problem, follow = follow_windows(problem_of(vehicle, {"buoyancy": {"force": 1.0}}, seed=4))
    stopped = fit_by_simulation(problem, Explanation((Term("buoyancy", ("force",), 1.0),)), follow, rounds=0)
    assert held_at(problem, stopped, {0: 0.0})[1] > 30


@pytest.mark.thorough
def test_no_effect_is_fitted_from_what_was_found_where_slack_may_do(tmp_path):
    """A sound vehicle with slack whose surge and sway nobody measures: the best fit of "no effect" decides."""
    case = Case(
        36,
        "no_gap_slack",
        plant="foreign",
        slack=0.03,
        sensors="stock",
        axes=("z", "roll", "pitch", "yaw", "p", "q", "r"),
    )
    heavy = load_vehicle("bluerov2_heavy")
    ((log, label),) = sealed_flights([case], heavy, seed=0)
    write_columns(hand_over(log, label).log, tmp_path / "log.csv")
    found = diagnose(read_flightlog(tmp_path / "log.csv", heavy), heavy)
    assert found.verdict is Verdict.NO_GAP
    assert any("surge, sway are not measured" in sentence for sentence in found.cannot_tell)


def test_a_thruster_that_never_leaves_its_dead_band_is_called_dead():
    """A limit below the dead band, of which no value fits better than another, is a thrust of zero with an interval."""
    values = {"thrust_limit": {"limit_1": 1.5, "limit_2": 2.7}}
    problem = problem_of(HELD, values, seed=3)
    limits = Explanation(
        tuple(Term("thrust_limit", (member,), limit) for member, limit in values["thrust_limit"].items())
    )
    found = search(*follow_windows(problem), lambda *_: None, [limits], further=False)
    dead = {(term.effect, term.members[0]): term.value for term in found.best.explanation.terms}
    assert dead == {("thruster_gain", f"gain_{i}"): pytest.approx(0.0, abs=0.01) for i in (1, 2)}
    assert (np.sqrt(np.diag(found.best.covariance)) < 0.04).all()  # the slack of a gain, 0.03, included
    assert any(fit is found.best for fit in found.fits)
