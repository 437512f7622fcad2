"""Held-out flight takes back effects and members of a family that it can do without, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
from flown_logs import fly, hold

from auv_torchrl.diagnosis.identify.explanation import Explanation, Term
from auv_torchrl.diagnosis.identify.fit import fit_by_simulation
from auv_torchrl.diagnosis.identify.following import follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.diagnosis.identify.neighbours import weighed
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.screen import Field
from auv_torchrl.diagnosis.identify.search import Found, search
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.validate.veto import take_back
from auv_torchrl.flightlog import Episode
from auv_torchrl.sysid.posterior import weights
from auv_torchrl.sysid.trace import Outcome, SearchTrace
from auv_torchrl.vehicle import load_vehicle

HELD, SETTINGS = hold(load_vehicle("paper")), load_settings()
BOTH = {"thruster_gain": {"gain_2": 0.5}, "buoyancy": {"force": 6.0}}
GAIN, FORCE = Term("thruster_gain", ("gain_2",), 0.5), Term("buoyancy", ("force",), 6.0)
LITTLE = Term("thruster_gain", ("gain_4",), 0.99)
DRAG = Term("added_mass", ("scale_yaw",), 0.98)


def found_as(*terms, flown=BOTH):
    """A log of a weak thruster and a load, another one to test on, and an explanation by some terms."""
    log, testing = (fly(HELD, flown, seed=seed, episodes=2, seconds=20.0) for seed in (41, 42))
    problem = Problem.of(cut_windows(log, SETTINGS.window_s, SETTINGS.lead_s, SETTINGS.bin_s), HELD, SETTINGS)
    problem, follow = follow_windows(problem)
    field = Field.of(problem, follow)
    none, best = (fit_by_simulation(problem, Explanation(some), follow, rounds=3) for some in ((), terms))
    record = weighed(problem, field, best.explanation, best.evidence, best.excess, "as given", Outcome.KEPT)
    return Found(problem, follow, none, best, (best, none), field, SearchTrace((record,))), testing


@pytest.mark.parametrize(
    ("terms", "stays"),
    [((GAIN, FORCE), (GAIN, FORCE)), ((GAIN, FORCE, DRAG), (GAIN, FORCE)), ((GAIN, LITTLE, FORCE), (GAIN, FORCE))],
)
def test_what_held_out_flight_can_do_without_is_taken_back(terms, stays):
    """Both true causes stay; an inertia of 0.98 and a second gain of 0.99 go, and the trace says why."""
    found, testing = found_as(*terms)
    kept = take_back(found, testing, SETTINGS)
    assert {term.key for term in kept.best.explanation.terms} == {term.key for term in stays}
    outcomes = [record.outcome for record in kept.trace.records]
    last = Outcome.KEPT if terms == stays else Outcome.LEFT
    assert outcomes == [Outcome.REFUTED] * (len(terms) - len(stays)) + [last]
    assert weights(kept.trace) == {kept.trace.best.names: 1.0}


def test_what_was_taken_back_beside_one_cause_is_so_beside_its_twin():
    """Another explanation with the same needless effect is no likelier one; alone the effect stays a rival."""
    found, testing = found_as(GAIN, FORCE, DRAG)
    (record,) = found.trace.records
    names = ("added_mass", "thruster_swap"), ("added_mass",)
    twin, alone = (replace(record, names=those, outcome=Outcome.BEATEN) for those in names)
    kept = take_back(replace(found, trace=SearchTrace((record, twin, alone))), testing, SETTINGS)
    outcomes = {one.names: one.outcome for one in kept.trace.records}
    assert outcomes[twin.names] is Outcome.REFUTED and outcomes[alone.names] is Outcome.BEATEN


def test_a_single_cause_that_the_log_asks_for_is_not_taken_back():
    """Whether it stands at all is asked against no effect."""
    found, testing = found_as(GAIN)
    assert take_back(found, testing, SETTINGS).best is found.best


def test_a_single_cause_without_which_nothing_is_left_is_taken_back():
    """A gain of 0.99 that is fitted to a sound flight."""
    found, testing = found_as(LITTLE, flown={})
    kept = take_back(found, testing, SETTINGS)
    assert not kept.best.explanation.effects
    assert [record.outcome for record in kept.trace.records] == [Outcome.REFUTED, Outcome.LEFT]


def test_held_out_flight_that_tells_nothing_does_not_speak_against_the_log():
    """A vehicle that lies still is predicted as well without its weak thruster, which the log tells of."""
    mass = Term("added_mass", ("scale_yaw",), 2.0)
    flown = {"thruster_gain": {"gain_2": 0.5}, "added_mass": {"scale_yaw": 2.0}}
    found, _ = found_as(GAIN, mass, flown=flown)
    settles = fly(HELD, flown, seed=42, episodes=2, seconds=20.0, effort=0.0)
    late = slice(-300, None)
    still = (Episode(e.number, e.t[late], e.pose[late], e.velocity[late], e.commands[late]) for e in settles.episodes)
    kept = take_back(found, replace(settles, episodes=tuple(still)), SETTINGS)
    assert {term.key for term in kept.best.explanation.terms} == {GAIN.key, mass.key}


def test_a_log_of_which_no_force_follows_a_window_is_searched_all_the_same():
    """A vehicle that tumbles at the surface leaves no number to predict by; the search ends, and divides by none."""
    found, _ = found_as(GAIN)
    lost = replace(found.problem, followed=np.zeros(len(found.problem.windows), bool))
    ended = search(lost, found.follow, lambda step, share: None, [found.best.explanation])
    assert ended.field.quadratic.numbers == 0 and ended.trace.best is not None
