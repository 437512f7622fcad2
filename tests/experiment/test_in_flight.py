"""The flight in which the scenario sets in: its schedule, what is found, what is said."""

import json

import numpy as np
import pytest
import torch

from auv_torchrl.adaptation.recovery import Happening
from auv_torchrl.experiment.flight_config import FlightConfig
from auv_torchrl.experiment.flight_figure import flight_figure
from auv_torchrl.experiment.in_flight import fly_in_flight
from auv_torchrl.experiment.schedule import schedule
from auv_torchrl.scenario import read_scenario
from auv_torchrl.vehicle import load_vehicle
from tests.helmsmen import helmsman_of_vessel

VEHICLE = load_vehicle("paper")
SETTINGS = FlightConfig(fly=True, length_s=40.0, fault_s=(5.0, 15.0))
REVERSED = {"effects": {"thruster_gain": {"gain_1": -1.0}}}


def weed(start_s: float, stop_s: float) -> dict:
    return {"effects": {"thruster_gain": {"gain_1": -1.0, "start_s": start_s, "stop_s": stop_s}}}


def test_a_scenario_without_times_begins_at_a_random_time_for_each_vehicle():
    """Between the two times, hardly ever the same, the same for the same seed, healthy before and reversed after."""
    reversed_1 = read_scenario("reversed", REVERSED, VEHICLE)
    plan = schedule(reversed_1, VEHICLE, SETTINGS, 50, 7, 0.05)
    (change,) = plan.changes
    assert change.what == "thruster_gain begins"
    assert float(change.at_s.min()) >= 5.0 and float(change.at_s.max()) <= 15.0 and len(change.at_s.unique()) > 40
    torch.testing.assert_close(schedule(reversed_1, VEHICLE, SETTINGS, 50, 7, 0.05).delay_s, plan.delay_s)
    assert float(change.before.gain[0]) == 1.0 and float(change.after.gain[0]) == -1.0


def test_a_scenario_with_times_is_flown_as_it_is_written():
    """Weed gets in at 4 s and falls off at 9 s, for all vehicles, and the vehicle is healthy again."""
    plan = schedule(read_scenario("weed", weed(4.0, 9.0), VEHICLE), VEHICLE, SETTINGS, 3, 0, 0.05)
    assert [(change.what, change.at_s.tolist()) for change in plan.changes] == [
        ("thruster_gain begins", [4.0] * 3),
        ("thruster_gain ends", [9.0] * 3),
    ]
    assert float(plan.changes[1].before.gain[0]) == -1.0 and float(plan.changes[1].after.gain[0]) == 1.0


def test_what_acts_from_the_start_is_a_change_at_0():
    """So that it does not count as a false alarm if it is noticed."""
    config = {"effects": {"current": {"north": 0.1}, **weed(4.0, 9.0)["effects"]}}
    plan = schedule(read_scenario("both", config, VEHICLE), VEHICLE, SETTINGS, 1, 0, 0.05)
    assert [change.what for change in plan.changes][0] == "current begins" and float(plan.changes[0].at_s) == 0.0


@pytest.mark.parametrize(
    ("settings", "error"),
    [
        ({"fault_s": (0.0, 15.0)}, "fault_s is .*: give a list of 2 entries, each a number above 0"),
        ({"fault_s": (15.0, 5.0)}, "0 < earliest <= latest"),
        ({"length_s": 20.0}, "give 25 or more"),
        ({"length_s": float("nan")}, "length_s is nan: give a number above 0"),
    ],
)
def test_times_that_do_not_fit_are_refused(settings, error):
    """The message says what does."""
    with pytest.raises(ValueError, match=error):
        FlightConfig(**{"fly": True, "length_s": 40.0, "fault_s": (5.0, 15.0), **settings})


def test_a_scenario_that_changes_too_late_is_refused_before_anything_is_computed(experiment):
    """Less than 10 s after the last change nothing could be said of the recovery."""
    with pytest.raises(ValueError, match="changes the vehicle last at 12 s and flight.length_s is 13"):
        experiment("weed")
    assert experiment("weed", "flight.fly=false").scenario.name == "weed"


@pytest.fixture(scope="module")
def flown(experiment, pd_policy):
    """Four flights of a capable controller in which thruster 1 comes to turn the wrong way."""
    faulty = experiment("reversed")
    return faulty, fly_in_flight(faulty, pd_policy)


def test_a_fault_in_flight_is_noticed_refitted_and_survived(flown):
    """All in one flight: noticed by all, the gain is found, the error stays far below that of u_s alone."""
    experiment, one = flown
    found = one.as_dict()
    json.dumps(found, allow_nan=False)
    (change,) = found["changes"]
    assert change["noticed"] == change["felt"] == 1.0 and found["false_alarms"] == 0
    assert change["delay_s"]["p90"] < 1.0 and change["refit_s"]["p90"] < 3.1
    assert change["steady_m"]["mean"] < 0.07  # the controller leaves 0.04 m inside the dead band
    assert found["remaining"]["rank"] == 4 and found["remaining"]["lost"] == []
    drawn = one.one_flight(experiment.vehicle)
    assert float(drawn.true_gains[-1, 0]) == pytest.approx(-1.0, abs=1e-6)
    torch.testing.assert_close(drawn.gains[-1], drawn.true_gains[-1], atol=0.15, rtol=0)


def test_the_moments_are_in_the_order_of_cause_and_effect(flown):
    """Change, alarm, settled map; the alarm is where the adapter reported it."""
    _, one = flown
    happened = one.moments_of(one.shown)
    first = {moment.happening: moment.time_s for moment in reversed(happened)}
    assert first[Happening.CHANGE] < first[Happening.NOTICED] < first[Happening.SETTLED]
    adapted = one.adapted.of_start(one.shown)
    assert first[Happening.NOTICED] == float(adapted.flight.time[adapted.alarm][0])


def test_the_summary_names_the_times_of_the_flight_that_is_shown(flown):
    """The console says when the change came, and in how many flights it was noticed."""
    _, one = flown
    at = float(one.schedule.changes[0].at_s[one.shown])
    assert f"thruster gain begins at {at:.1f} s, noticed after" in one.summary()
    assert "Of 4 flights 100\u202f% noticed it" in one.summary()


def test_the_figure_marks_every_moment_in_every_panel(flown):
    """A vertical line at the time of each."""
    experiment, one = flown
    drawn = one.one_flight(experiment.vehicle)
    times = sorted(moment.time_s for moment in drawn.moments)
    for axes in flight_figure(drawn, "reversed").axes:
        ends = [np.unique(np.asarray(line.get_xdata(), dtype=float)) for line in axes.lines]
        vertical = sorted(float(x[0]) for x in ends if len(x) == 1)
        assert vertical == pytest.approx(times)


def test_of_an_infeasible_vehicle_it_is_named_what_remains(experiment, pd_policy):
    """Two dead thrusters leave rank 3: found in flight from the estimated map, and said."""
    one = fly_in_flight(experiment("two_dead"), pd_policy)
    assert one.as_dict()["remaining"]["rank"] == 3
    assert "3 of 4 degrees of freedom can be controlled" in one.summary()


def test_of_a_vehicle_that_steers_its_heading_is_told_too(experiment):
    """A vessel whose plugs come to be exchanged in flight: the heading is kept with the adaptation, not without."""
    settings = ("task=cruise", "vehicle=otter", "agent=gradient", "randomization=none", "flight.length_s=16")
    one = fly_in_flight(experiment("swap", *settings), helmsman_of_vessel())
    found = one.as_dict()
    json.dumps(found, allow_nan=False)
    assert found["changes"][0]["noticed"] == 1.0 and found["changes"][0]["steady_rad"] < np.radians(3.0)
    assert one.alone_heading_rad(0) > np.radians(30.0)
    assert "heading error" in one.summary() and found["remaining"]["rank"] == 2
    assert one.one_flight(load_vehicle("otter")).true_gains.shape[-1] == 2
