"""A thruster that pushes otherwise than commanded is found by gains of its own from moment to moment."""

from dataclasses import replace

import pytest

from auv_torchrl.diagnosis import Verdict, diagnose
from auv_torchrl.diagnosis.calibrate.parameters import load_uncertainty
from auv_torchrl.diagnosis.identify.following import follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.localize.moments import changing_thruster
from auv_torchrl.diagnosis.localize.unlike import left_at_best
from auv_torchrl.diagnosis.log_search import search_both_attitudes
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.effects.effect import changed
from auv_torchrl.sysid.trace import Outcome
from auv_torchrl.vehicle import load_vehicle
from benchmarks.blind.flights.cases import Case
from benchmarks.blind.flights.fly import fly
from benchmarks.blind.flights.sensor_sets import sensor_set
from benchmarks.owners.acts import ACTS

HEAVY, SETTINGS, SENSORS = load_vehicle("bluerov2_heavy"), load_settings(), "mocap"


def flown(act, number=3, seed=2, slack=0.0):
    """One flight of 40 s, and its label; of the vehicle of the file, or of one that is off by ``slack``."""
    axes = sensor_set(SENSORS).axes
    case = Case(number, "outside", outside=act, sensors=SENSORS, axes=axes, slack=slack, episodes=2, episode_s=20.0)
    return fly([case], HEAVY, seed, ACTS)[0]


def moments(act, number=3, seed=2):
    """What is found along the measured motion of one flight, and its label."""
    log, label = flown(act, number, seed)
    windows = cut_windows(log, SETTINGS.window_s, SETTINGS.lead_s, SETTINGS.bin_s)
    return changing_thruster(*follow_windows(Problem.of(windows, HEAVY, SETTINGS))), label.get("drawn", {})


@pytest.mark.parametrize("act", ["one_way", "stuck", "sticking", "wandering", "comes_and_goes"])
def test_the_thruster_that_pushes_otherwise_is_found(act):
    """Whatever it does: no library has to know what that is."""
    found, drawn = moments(act)
    assert found is not None and found.thruster == drawn["thruster"]


def test_a_thruster_that_comes_and_goes_is_said_to_with_its_share_of_the_time():
    """Gains are near one or near nothing; the share without thrust lies in its interval."""
    found, drawn = moments("comes_and_goes", number=4)
    said = found and found.intermittence()
    assert said is not None and said.low <= drawn["share"] <= said.high and said.high - said.low < 0.5


@pytest.mark.parametrize("act", ["comes_and_goes", pytest.param("sticking", marks=pytest.mark.thorough)])
def test_no_sound_thruster_is_blamed_beside_one_that_pushes_otherwise(act):
    """Effects that together stand in for it are less likely than the thruster itself; the file is off a little."""
    log, label = flown(act, slack=0.03)
    diagnosis = diagnose(log, HEAVY)
    assert diagnosis.verdict is Verdict.UNEXPLAINED and not diagnosis.effects
    shares = diagnosis.where.thruster
    assert int(max(shares, key=shares.__getitem__)) == label["drawn"]["thruster"]
    assert (diagnosis.where.intermittence is not None) == (act == "comes_and_goes")
    assert any(one.outcome in (Outcome.CHANGING, Outcome.OUTDONE) for one in diagnosis.decision.trace)


@pytest.mark.parametrize(("number", "slack"), [(1, 0.03), pytest.param(4, 0.0, marks=pytest.mark.thorough)])
def test_a_loose_plug_is_told_before_a_file_that_is_off(number, slack):
    """As an owner asks, with a file that says it is a guess: none of its coefficients takes up a part of the fault."""
    log, label = flown("comes_and_goes", number=number, slack=slack)
    diagnosis = diagnose(log, HEAVY, uncertainty=load_uncertainty("bluerov2_heavy", HEAVY))
    assert not diagnosis.effects and diagnosis.where.intermittence is not None
    assert diagnosis.where.intermittence.thruster == label["drawn"]["thruster"]


@pytest.mark.parametrize(("act", "far_less"), [("comes_and_goes", True), (None, False)])
def test_what_one_thruster_leaves_is_what_sensors_are_held_against(act, far_less):
    """A sensor contradicts others only where without it far less is left than one thruster leaves, if one explains."""
    settings = replace(SETTINGS, most_effects=0)
    found = search_both_attitudes(flown(act)[0], HEAVY, (), settings, lambda step, share: None).found
    assert (left_at_best(found) < 0.1 * found.excess) == far_less


@pytest.mark.slow
def test_beside_a_file_that_may_be_off_nothing_is_said_of_what_one_thruster_gives():
    """The file is off by 30 %, and a thruster is stuck: where to look is told, and neither as a fact."""
    log, label = flown("stuck", slack=0.3)
    diagnosis = diagnose(log, HEAVY, uncertainty=load_uncertainty("bluerov2_heavy", HEAVY))
    thruster = label["drawn"]["thruster"]
    assert diagnosis.headline == f"The vehicle's file may be off; something unknown acts at thruster {thruster}."
    assert diagnosis.where.thrust_map is None and not any(effect.probability > 0.5 for effect in diagnosis.effects)


def test_a_thruster_that_wanders_is_not_said_to_come_and_go():
    """Its gain is anything between."""
    found, _ = moments("wandering")
    assert found is not None and found.intermittence() is None


def test_no_thruster_is_found_on_a_sound_vehicle():
    """Nor is one where all of them are as they should be."""
    assert moments(None)[0] is None


@pytest.mark.parametrize(
    "wrong",
    [{"quadratic_drag": 2.0, "linear_drag": 2.0}, {"inertia": 3.0}, {"gain": 0.5}],
    ids=lambda one: next(iter(one)),
)
def test_no_sound_thruster_is_blamed_for_a_file_that_is_wrong_by_factors(wrong):
    """One stands out from all others by what it takes up of the file's errors, a small part of them."""
    case = Case(3, "no_gap", sensors=SENSORS, axes=sensor_set(SENSORS).axes, episodes=2, episode_s=20.0)
    ((log, _),) = fly([case], HEAVY, 2)
    vehicle = changed(HEAVY, **{name: getattr(HEAVY, name) * factor for name, factor in wrong.items()})
    windows = cut_windows(log, SETTINGS.window_s, SETTINGS.lead_s, SETTINGS.bin_s)
    assert changing_thruster(*follow_windows(Problem.of(windows, vehicle, SETTINGS))) is not None
    diagnosis = diagnose(log, vehicle, settings=replace(SETTINGS, most_effects=0))
    assert diagnosis.verdict is Verdict.UNEXPLAINED and "otherwise" not in diagnosis.summary + diagnosis.headline
