"""Values and intervals as their reader sees them: as sure as the log and what is known of the vehicle make them."""

from dataclasses import replace

import numpy as np
import pytest
from flown_logs import fly, hold, with_slack
from hypothesis import given, settings
from hypothesis import strategies as st

from auv_torchrl.diagnosis.calibrate.parameters import VehicleEstimate, guess_nuisance
from auv_torchrl.diagnosis.calibrate.scale_ambiguity import measure_ambiguity
from auv_torchrl.diagnosis.identify.assess import joint_precision
from auv_torchrl.diagnosis.identify.explanation import Explanation, Term
from auv_torchrl.diagnosis.identify.fit import fit_by_simulation
from auv_torchrl.diagnosis.identify.following import follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.diagnosis.identify.problem import HealthyPrior, Problem
from auv_torchrl.diagnosis.identify.sure import as_sure
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.vehicle import load_vehicle

PAPER = load_vehicle("paper")
HELD = hold(PAPER)
SETTINGS = load_settings()
SHORT = {"episodes": 3, "seconds": 20.0}
GAIN = ("thruster_gain", "gain_4")


def problem_of(vehicle, values, seed):
    """A problem of a short flight of a vehicle."""
    log = fly(vehicle, values, seed=seed, **SHORT)
    return Problem.of(cut_windows(log, SETTINGS.window_s, SETTINGS.lead_s, SETTINGS.bin_s), HELD, SETTINGS)


@pytest.fixture(scope="module")
def weak():
    """A thruster of 60 %, followed and explained."""
    problem, follow = follow_windows(problem_of(HELD, {GAIN[0]: {GAIN[1]: 0.6}}, 3))
    return problem, fit_by_simulation(problem, Explanation((Term(GAIN[0], (GAIN[1],), 0.6),)), follow)


def test_intervals_are_as_wide_as_the_slack_that_a_log_shows():
    """Of a vehicle that is as its file says, a drag coupling is told twice as well as of one that is a little off."""
    values = {"drag_coupling": {"drag_sway_from_yaw": 9.9}}
    term = Term("drag_coupling", ("drag_sway_from_yaw",), 9.9)

    def widths(vehicle):
        """Deviation of the coupling with slack as wide as assumed, and as wide as it shows."""
        problem = problem_of(vehicle, values, seed=6)
        problem, follow = follow_windows(problem)
        fit = fit_by_simulation(problem, Explanation((term,)), follow)
        explanation, covariance = as_sure(problem, fit)
        assert explanation.terms[0].value == pytest.approx(9.9, abs=3 * np.sqrt(covariance[0, 0]))
        return np.sqrt(fit.covariance[0, 0]), np.sqrt(covariance[0, 0])

    assumed, shown = widths(HELD)
    assert shown < 0.6 * assumed
    assumed, shown = widths(with_slack(HELD, np.random.default_rng(2)))
    assert shown > 0.8 * assumed


def test_forces_are_as_unsure_as_the_scale_of_the_vehicle_and_shares_are_not():
    """Whether a vehicle is light or heavy, half of a thrust is half, and nobody can say how many newtons a push has."""
    log = fly(HELD, {GAIN[0]: {GAIN[1]: 0.6}, "buoyancy": {"force": 6.0}}, seed=3, **SHORT)
    windows = cut_windows(log, SETTINGS.window_s, SETTINGS.lead_s, SETTINGS.bin_s)
    estimate = VehicleEstimate.from_file(HELD, guess_nuisance(HELD, SETTINGS, (), windows))
    covariance = 1e-4 * estimate.covariance
    first = Problem.of(windows, HELD, SETTINGS)
    known = HealthyPrior(
        np.array(SETTINGS.floor_force), first.sigma, first.rough_noise, estimate.nuisance.entries, covariance
    )
    problem, follow = follow_windows(Problem.of(windows, HELD, SETTINGS, known))
    terms = Term(GAIN[0], (GAIN[1],), 0.6), Term("buoyancy", ("force",), 6.0)
    fit = fit_by_simulation(problem, Explanation(terms), follow)
    open_still = replace(known, scales=measure_ambiguity(estimate))
    (held, before), (said, after) = (
        as_sure(replace(problem, known=one.beside(problem.nuisance)), fit) for one in (known, open_still)
    )
    assert said.terms == held.terms
    share, force = np.sqrt(np.diag(after) / np.diag(before))
    assert share == pytest.approx(1.0, abs=0.05)
    assert force > 5
    assert np.sqrt(after[1, 1]) == pytest.approx(0.14 * 6.0, rel=0.5)


@settings(max_examples=20, deadline=None)
@given(by=st.floats(-0.05, 0.05))
def test_a_value_is_the_same_however_a_fit_shares_it_with_slack(weak, by):
    """Slack of a gain does what its value does: a fit that stops anywhere between the two tells one value."""
    problem, fit = weak
    (term,), nuisance = fit.explanation.terms, fit.explanation.nuisance
    shared = Explanation((replace(term, value=term.value - by),), {**nuisance, GAIN: nuisance[GAIN] + by})
    (told,), covariance = as_sure(problem, fit)[0].terms, as_sure(problem, fit)[1]
    (again,) = as_sure(problem, replace(fit, explanation=shared))[0].terms
    assert again.value == pytest.approx(told.value, abs=1e-6)
    assert told.value == pytest.approx(0.6, abs=3 * np.sqrt(covariance[0, 0]))


def with_flights(problem, share):
    """The problem where flights have told its slack, and leave ``share`` of the covariance open of the vehicle."""
    covariance = problem.nuisance_covariance
    known = HealthyPrior(problem.floor, problem.sigma, problem.rough_noise, problem.nuisance, covariance)
    return replace(problem, known=replace(known, shrinks=share * covariance))


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_what_flights_leave_open_of_a_vehicle_stays_open(weak, share):
    """A log that shows a vehicle near its calibrated numbers makes these no surer than the flights have made them."""
    problem, fit = weak
    narrowed = as_sure(problem, fit)[1][0, 0]
    wide, least = as_sure(with_flights(problem, share), fit)[1][0, 0], share * problem.nuisance_covariance[3, 3]
    assert problem.nuisance[3][:2] == GAIN
    assert wide > 0.99 * max(narrowed, least)
    assert wide < 1.01 * fit.covariance[0, 0]


def test_a_value_is_no_surer_for_slack_that_its_fit_has_held():
    """A tether counts what flights leave open of the vehicle, although its log tells little of that by itself."""
    values = {"north": 3.0, "east": 0.0, "down": -2.0, "stiffness": 5.0}
    problem = with_flights(problem_of(HELD, {"tether": values}, 4), 1.0)
    problem, follow = follow_windows(problem)
    fit = fit_by_simulation(problem, Explanation(tuple(Term("tether", (k,), v) for k, v in values.items())), follow)
    told = as_sure(problem, fit)[1].diagonal()
    held = np.linalg.inv(fit.quadratic.A + joint_precision(problem.nuisance_precision, np.zeros(4)))
    held = held.diagonal()[len(problem.nuisance) :] * fit.steps**2
    assert (told > 0.99 * held).all()
    assert (told > 1.1 * held).any()
