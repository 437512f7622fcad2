"""What sound flights differ by among themselves is no finding beside a fault, either."""

import pytest

from auv_torchrl.diagnosis.calibrate.calibration import calibrate
from auv_torchrl.diagnosis.identify.assess import parted_from_nuisance
from auv_torchrl.diagnosis.identify.explanation import Explanation, Term
from auv_torchrl.diagnosis.identify.following import follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import apply_values, load_settings
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.search import search
from auv_torchrl.diagnosis.motion.cut import cut_windows
from tests.diagnosis.flown_logs import fly
from tests.diagnosis.healthy_flights import FAULT, FILE, OWN, flown

pytestmark = pytest.mark.thorough  # half a minute of calibration; test_calibration has a fault beside one flight
SETTINGS = load_settings()
INERTIA = ("scale_surge", "scale_sway", "scale_heave", "scale_yaw")
FAULTY = Term("thruster_gain", ("gain_3",), 0.6)
OTHER_DAY = (Term("thruster_gain", ("gain_1",), 1.03), Term("added_mass", INERTIA, 0.97))


@pytest.fixture(scope="module")
def sound():
    """The vehicle as two healthy flights show it, far from its file."""
    return calibrate([flown("monday", seed=1), flown("tuesday", seed=2)], FILE, SETTINGS)


def searched(sound, values, terms):
    """What a search that was given these terms finds in a flight with such values."""
    log = fly(apply_values(OWN, {"added_mass": {"scale_yaw": 0.98}}), values, seed=5, episodes=3, seconds=20.0)
    windows = cut_windows(log, SETTINGS.window_s, SETTINGS.lead_s, SETTINGS.bin_s)
    problem, follow = follow_windows(Problem.of(windows, sound.vehicle, SETTINGS, sound.prior))
    return search(problem, follow, lambda *_: None, [Explanation(terms)], further=False)


def test_what_flights_differ_by_is_not_named_beside_a_fault(sound):
    """Of a weak thruster, another that pushes 3 % more and 3 % less inertia, the weak thruster alone is a finding."""
    found = searched(sound, FAULT, (FAULTY, *OTHER_DAY))
    assert found.best.explanation.effects == ("thruster_gain",)
    (term,) = found.best.explanation.terms
    assert term.members == ("gain_3",)
    assert term.value == pytest.approx(0.6, abs=0.03)


def test_two_weak_thrusters_are_both_named(sound):
    """A second thruster that is weak by more than flights differ by stays a finding beside the first one."""
    values = {"thruster_gain": {"gain_3": 0.6, "gain_1": 0.8}}
    found = searched(sound, values, (FAULTY, Term("thruster_gain", ("gain_1",), 0.8)))
    assert {term.members[0]: term.value for term in found.best.explanation.terms} == {
        "gain_3": pytest.approx(0.6, abs=0.03),
        "gain_1": pytest.approx(0.8, abs=0.03),
    }


def test_a_value_is_said_whole_whatever_slack_undoes_of_it(sound):
    """A gain of 0.75 of which slack takes 0.15 is said as 0.6, and the vehicle stays the same."""
    problem = searched(sound, FAULT, (FAULTY,)).problem
    split = Explanation((Term("thruster_gain", ("gain_3",), 0.75),), {("thruster_gain", "gain_3"): -0.15})
    said = parted_from_nuisance(problem, split)
    assert said.terms[0].value == pytest.approx(0.6, abs=0.005)
    assert said.values(problem.vehicle)["thruster_gain"]["gain_3"] == pytest.approx(0.6)
