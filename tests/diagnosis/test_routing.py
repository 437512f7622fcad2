"""Plugs on other outputs: one proposal for all of them, one cause with one sentence, and what it costs."""

from dataclasses import replace
from math import log

import numpy as np
import pytest
from flown_logs import fly, hold
from hypothesis import given
from hypothesis import strategies as st

from auv_torchrl.diagnosis import Verdict, diagnose
from auv_torchrl.diagnosis.identify.explanation import Explanation, Term, derangements, exchanges, rings
from auv_torchrl.diagnosis.identify.following import follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.routing import propose_routing
from auv_torchrl.diagnosis.identify.search import search
from auv_torchrl.diagnosis.lengths import stretches_of
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.motion.smooth import misfit
from auv_torchrl.diagnosis.thresholds import LOST, ONE_MORE_VALUE, WORTH_AN_EFFECT
from auv_torchrl.diagnosis.unanswered.both_readings import follows_otherwise
from auv_torchrl.effects import EFFECTS
from auv_torchrl.effects.effect import changed
from auv_torchrl.flightlog import read_flightlog
from auv_torchrl.flightlog.log import POSE
from auv_torchrl.physics import prepare
from auv_torchrl.vehicle import load_vehicle
from benchmarks.blind.flights.cases import Case
from benchmarks.blind.flights.fly import fly as fly_sealed
from benchmarks.blind.flights.sensor_sets import sensor_set
from benchmarks.owners.acts import ACTS
from tests.flightlog.shared_data import shared

PAPER, HEAVY = load_vehicle("paper"), load_vehicle("bluerov2_heavy")
SETTINGS = load_settings()
USED = [0, 1, 2, 5]  # degrees of freedom that the pilot of these logs uses: vertical thrusters get one command


def wrench(values, vehicle=PAPER):
    """The wrench per demand of the pilot of a level vehicle with some effects."""
    mixer = vehicle.mixer[:, USED]
    for name, row in values.items():
        vehicle = EFFECTS[name].apply(vehicle, row)
    c = prepare(vehicle).numpy()
    return (c.allocation[USED] * c.full_thrust) @ c.routing @ mixer


@pytest.mark.parametrize("seed", range(3))
def test_any_plugs_are_proposed_at_once(seed):
    """Exchanged, cycled and reversed ones together, as far as the commands of the log tell them apart."""
    rng = np.random.default_rng(seed)
    giver, sign = rng.permutation(6), rng.choice((-1.0, 1.0), 6, p=(0.3, 0.7))
    swapped = {f"command_{i + 1}": float(j + 1) for i, j in enumerate(giver)}
    gains = {f"gain_{i + 1}": float(s) for i, s in enumerate(sign)}
    vehicle = hold(PAPER)
    truth = {"thruster_swap": swapped, "thruster_gain": gains}
    flown = fly(vehicle, truth, seed=seed, episodes=2, seconds=20.0)
    problem = Problem.of(cut_windows(flown, SETTINGS.window_s, SETTINGS.lead_s, SETTINGS.bin_s), vehicle, SETTINGS)
    problem, follow = follow_windows(problem)
    proposed = propose_routing(problem, follow, Explanation())
    assert proposed is not None
    np.testing.assert_allclose(wrench(proposed.explanation.values(PAPER)), wrench(truth), atol=1e-9)


@pytest.mark.parametrize("seed", range(2))
def test_any_plugs_are_proposed_of_thrusters_that_push_harder_ahead(seed):
    """A propeller that turns the wrong way then pushes otherwise than one with a gain of -1."""
    rng, vehicle = np.random.default_rng(seed), hold(HEAVY)
    giver, sign = rng.permutation(8), rng.choice((-1.0, 1.0), 8, p=(0.3, 0.7))
    truth = {"thruster_swap": {f"command_{i}": float(g) for i, g in enumerate(sign * (giver + 1), start=1)}}
    flown = fly(vehicle, truth, seed=seed, episodes=2, seconds=20.0)
    problem = Problem.of(cut_windows(flown, SETTINGS.window_s, SETTINGS.lead_s, SETTINGS.bin_s), vehicle, SETTINGS)
    problem, follow = follow_windows(problem)
    proposed = propose_routing(problem, follow, Explanation())
    assert proposed is not None and proposed.explanation.effects == ("thruster_swap",)
    np.testing.assert_allclose(wrench(proposed.explanation.values(HEAVY), HEAVY), wrench(truth, HEAVY), atol=1e-9)


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.thorough)])
def test_plugs_that_make_a_vehicle_tumble_are_found(seed):
    """It turns through the vertical again and again, where roll and yaw jump."""
    exchanged = {"command_2": 5.0, "command_5": 2.0}
    flown = fly(HEAVY, {"thruster_swap": exchanged}, seed=seed, axes=POSE, episodes=3, seconds=20.0)
    assert np.abs(np.concatenate([e.pose[:, POSE.index("pitch")] for e in flown.episodes])).max() > 1.5
    diagnosis = diagnose(flown, HEAVY)
    assert diagnosis.verdict is Verdict.EXPLAINED
    (effect,) = diagnosis.effects
    assert {name: value.value for name, value in effect.parameters.items()} == exchanged
    doubts = {finding.code for finding in diagnosis.findings}
    assert "outliers" not in doubts  # it turns fast, and no sensor is to be checked for that


@pytest.mark.parametrize("which", [1, pytest.param(3, marks=pytest.mark.thorough)])
def test_a_propeller_that_turns_the_wrong_way_is_one_cause(which):
    """Also where it pushes less hard that way, and with what to do about it."""
    vehicle = hold(HEAVY)
    turned = {"thruster_swap": {f"command_{which}": -float(which)}}
    diagnosis = diagnose(fly(vehicle, turned, seed=which, episodes=3, seconds=20.0), vehicle)
    (effect,) = diagnosis.effects
    assert effect.name == "thruster_swap" and effect.probability > 0.9 and effect.thrusters == (which,)
    assert effect.parameters[f"command_{which}"].value == -which
    assert effect.sentence == f"thruster {which} turns the wrong way"
    (advice,) = effect.advice
    assert f"MOT_{which}_DIRECTION" in advice.do


def test_plugs_that_are_where_they_belong_are_not_proposed():
    """Whatever else is wrong."""
    vehicle = hold(PAPER)
    flown = fly(vehicle, {"buoyancy": {"force": 8.0}}, seed=1, episodes=2, seconds=20.0)
    problem = Problem.of(cut_windows(flown, SETTINGS.window_s, SETTINGS.lead_s, SETTINGS.bin_s), vehicle, SETTINGS)
    problem, follow = follow_windows(problem)
    assert propose_routing(problem, follow, Explanation((Term("buoyancy", ("force",), 8.0),))) is None


def test_two_exchanged_pairs_are_one_cause():
    """One sentence and one piece of advice for both, from a log of another simulator."""
    log = read_flightlog(shared("field/p_doubleswap.csv"), PAPER)
    diagnosis = diagnose(replace(log, episodes=log.episodes[:2]), PAPER)
    assert diagnosis.verdict is Verdict.EXPLAINED
    (effect,) = diagnosis.effects
    assert effect.name == "thruster_swap" and effect.thrusters == (1, 2, 3, 4) and effect.probability > 0.9
    assert effect.sentence == "the plugs of thrusters 1 and 2, and 3 and 4 are exchanged"
    (advice,) = effect.advice
    assert advice.do.startswith("exchange the plugs of motors 1 and 2, and 3 and 4")


@given(st.permutations(range(8)))
def test_rings_take_one_exchange_less_than_they_are_long(order):
    """So that sorting by exchanges ends with as many; a plug that sits right is a ring of one."""
    left, count = list(order), 0
    for place in range(8):
        while left[place] != place:
            other = left[place]
            left[place], left[other] = left[other], left[place]
            count += 1
    giver = dict(enumerate(order))
    assert exchanges(giver) == count
    assert sorted(number for ring in rings(giver) for number in ring) == list(range(8))


@pytest.mark.parametrize(("count", "ways"), [(2, 1), (3, 2), (4, 9), (5, 44), (6, 265), (8, 14833)])
def test_ways_in_which_all_plugs_sit_elsewhere(count, ways):
    """Permutations without a fixed point, as counted in any book on combinatorics."""
    assert derangements(count) == ways


def test_a_permutation_costs_its_plugs():
    """A second exchange is a value and a mishap more, and each set of plugs of one size is as likely as another."""
    prior = Problem.of(
        cut_windows(fly(PAPER, {}, episodes=2, seconds=20.0), 2.0, 1.5, 0.2), PAPER, replace(SETTINGS, ignored=())
    ).prior

    def cost(*rings_of):
        terms = (
            Term("thruster_swap", (f"command_{to}",), float(by), True)
            for ring in rings_of
            for by, to in zip(ring, ring[1:] + ring[:1], strict=True)
        )
        return prior.structure(Explanation(tuple(terms)))

    assert cost((1, 2)) - cost((1, 2), (3, 4)) == pytest.approx(
        log(15 * 9 / 15) - log(ONE_MORE_VALUE) + WORTH_AN_EFFECT
    )
    assert cost((1, 2, 3)) == cost((4, 6, 5))
    reversed_one = Explanation((Term("thruster_swap", ("command_3",), -3.0, True),))
    assert prior.structure(reversed_one) == pytest.approx(
        prior.structure(Explanation((Term("thruster_gain", ("gain_3",), -1.0),)))
    )


def searched(flown, vehicle, begin=()):
    """The problem of a flight, and what a search for effects found that begins with some explanations."""
    problem, follow = follow_windows(
        Problem.of(cut_windows(flown, SETTINGS.window_s, SETTINGS.lead_s, SETTINGS.bin_s), vehicle, SETTINGS)
    )
    return problem, search(problem, follow, lambda step, share: None, begin)


def test_a_motion_that_no_force_per_bin_follows_is_known_all_the_same():
    """Thrust changes within a bin where plugs are exchanged: what a force leaves is little beside what it makes up for.

    With the sensors of a stock vehicle many windows are left beyond their noise, and all plugs are found.
    """
    sensors = "stock"
    case = Case(
        1, "wiring", outside="replugged", sensors=sensors, axes=sensor_set(sensors).axes, episodes=2, episode_s=20.0
    )
    flown, label = fly_sealed([case], HEAVY, 1, ACTS)[0]
    problem, found = searched(stretches_of(flown), HEAVY)
    left = misfit(problem.windows, found.follow.state.residual, problem.sigma)
    assert (left > LOST).mean() > 0.3 and problem.followed.all()
    drawn = label["drawn"]
    ways = [-1.0 if number in drawn["backwards"] else 1.0 for number in range(1, 9)]
    plugs = {f"command_{i}": way * giver for i, (way, giver) in enumerate(zip(ways, drawn["giver"], strict=True), 1)}
    moved = {name: value for name, value in plugs.items() if name != f"command_{value:.0f}"}
    assert found.best.explanation.values(HEAVY, nuisance=False) == {"thruster_swap": moved}


def test_a_plug_takes_the_place_of_two_gains_that_do_the_same():
    """A thruster that turns the wrong way pushes less hard: beside exchanged plugs that is one plug more, not gains."""
    truth = {"thruster_swap": {"command_1": 2.0, "command_2": 1.0, "command_3": -3.0}}
    vehicle = hold(HEAVY)
    flown = fly(vehicle, truth, seed=2, episodes=2, seconds=20.0)
    swapped = (Term("thruster_swap", (f"command_{i}",), float(j), True) for i, j in ((1, 2), (2, 1)))
    gains = Term("thruster_gain", ("gain_3",), -1.0), Term("forward_gain", ("gain_3",), 0.8)
    _, found = searched(flown, vehicle, [Explanation((*swapped, *gains))])
    assert found.best.explanation.values(vehicle, nuisance=False) == truth


def test_a_reversed_plug_with_a_gain_of_minus_one_is_nothing():
    """The two go together, and the plugs beside them stay: without one of the two much would be left."""
    truth = {"thruster_swap": {"command_1": 2.0, "command_2": 1.0}}
    vehicle = hold(HEAVY)
    flown = fly(vehicle, truth, seed=2, episodes=2, seconds=20.0)
    plugs = (Term("thruster_swap", (f"command_{i}",), j, True) for i, j in ((1, 2.0), (2, 1.0), (3, -3.0)))
    begin = Explanation((*plugs, Term("thruster_gain", ("gain_3",), -1.0)))
    _, found = searched(flown, vehicle, [begin])
    assert found.best.explanation.values(vehicle, nuisance=False) == truth


def test_a_vehicle_whose_plugs_are_exchanged_follows_its_commands():
    """Others do what is commanded, whether the file has its thrust right or not; no plugs make another flight."""
    vehicle = hold(PAPER)
    plugs = {"thruster_swap": {"command_1": 4.0, "command_4": 5.0, "command_5": 1.0, "command_6": -6.0}}
    flown = fly(vehicle, plugs, seed=1, episodes=2, seconds=20.0)
    assert follows_otherwise(searched(flown, vehicle)[1])
    assert follows_otherwise(searched(flown, changed(vehicle, gain=1.1 * vehicle.gain))[1])
    other = fly(vehicle, {}, seed=2, episodes=2, seconds=20.0)
    of_another = tuple(replace(mine, pose=its.pose) for mine, its in zip(flown.episodes, other.episodes, strict=True))
    assert not follows_otherwise(searched(replace(flown, episodes=of_another), vehicle)[1])
