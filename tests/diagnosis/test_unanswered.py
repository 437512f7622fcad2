"""Channels that do not answer to commands: told before any fault of the vehicle, and never where they do answer."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from auv_torchrl.diagnosis import Verdict, diagnose
from auv_torchrl.diagnosis.calibrate.parameters import load_uncertainty
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.following import follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.report.table import summary_table
from auv_torchrl.diagnosis.unanswered.both_readings import FAR_LESS
from auv_torchrl.diagnosis.unanswered.held import beside, find_held
from auv_torchrl.diagnosis.unanswered.other_source import Suspect, find_other_source, in_all_flight, left_by
from auv_torchrl.diagnosis.unanswered.stillness import Stillness, find_stillness, hardly_moves
from auv_torchrl.diagnosis.unanswered.weigh import without
from auv_torchrl.diagnosis.unanswered.wording import named, not_answering, tell
from auv_torchrl.diagnosis.verdict import Where
from auv_torchrl.effects import EFFECTS
from auv_torchrl.effects.effect import changed
from auv_torchrl.flightlog import POSE, read_flightlog
from auv_torchrl.vehicle import load_vehicle
from benchmarks.blind.flights.cases import Case
from benchmarks.blind.flights.fly import fly as fly_cases
from benchmarks.blind.flights.sensor_sets import sensor_set
from benchmarks.owners.acts import ACTS
from tests.diagnosis.flown_logs import as_read, fly, hold
from tests.diagnosis.stuck_channels import GROUPS, rocked, stuck
from tests.flightlog.shared_data import shared

SETTINGS = load_settings()
VEHICLES = ("paper", "bluerov2", "bluerov2_heavy")
FAULT = {"thruster_gain": {"gain_1": 0.5}}
COLUMNS = {"floats_s": ("z",), "n_xy": ("x", "y"), "n_yaw": ("yaw",), "deck_s": ("x", "y", "z", "yaw")}


@cache
def flown(name, fault="sound", seed=1):
    """A flight with positions and heading, of a vehicle that is sound or has a weak thruster."""
    return fly(load_vehicle(name), FAULT if fault == "weak" else {}, seed=seed, episodes=4, seconds=24.0)


def told(diagnosis):
    """Columns of the findings about what does not answer."""
    return [finding.columns for finding in not_answering(diagnosis.findings)]


def likely(diagnosis):
    """Effects that are said to be likelier than not."""
    return [effect for effect in diagnosis.effects if effect.is_likely]


@pytest.mark.parametrize("group", GROUPS)
@pytest.mark.parametrize("fault", ("sound", "weak"))
@pytest.mark.parametrize("name", VEHICLES)
def test_what_stands_still_all_along_is_found_and_nothing_else(name, fault, group):
    """With a third of the usual noise and with three times as much, beside a sound and beside a weak thruster."""
    log = flown(name, fault)
    wanted = {channel for channel in GROUPS[group] if channel in log.axes}
    for size in (0.3, 1.0, 3.0):
        found = find_stillness(stuck(log, tuple(wanted), size), load_vehicle(name), SETTINGS)
        assert {entry.channel for entry in found} == wanted
        assert all(entry.episode is None for entry in found)


@pytest.mark.parametrize("name", VEHICLES)
def test_a_stretch_is_found_to_the_second(name):
    """Depth that stands still from 8 s to 20 s of episodes in which the vehicle is driven."""
    log = stuck(flown(name), ("z",), stretch=(8.0, 20.0))
    found = [entry for entry in find_stillness(log, load_vehicle(name), SETTINGS) if entry.episode in (1, 3)]
    assert {entry.channel for entry in found} == {"z"} and {entry.episode for entry in found} == {1, 3}
    for entry in found:
        assert entry.first_s == pytest.approx(8.0, abs=1.0) and entry.last_s == pytest.approx(20.0, abs=1.0)


def test_a_sensor_that_is_stuck_for_a_while_is_stuck_in_all_that_it_measures():
    """Roll and pitch may be held level while a vehicle is driven; where heading stands still with them, none is."""
    heavy, attitude = load_vehicle("bluerov2_heavy"), ("roll", "pitch", "yaw")
    axes = ("x", "y", "z", *attitude)
    log = fly(heavy, {"thruster_swap": {"command_2": -2.0}}, seed=1, episodes=2, seconds=24.0, axes=axes)
    for channels, wanted in ((attitude, set(attitude)), (("yaw",), {"yaw"}), (attitude[:2], set())):
        found = find_stillness(stuck(log, channels, stretch=(8.0, 20.0)), heavy, SETTINGS)
        assert {entry.channel for entry in found} == wanted and all(entry.episode is not None for entry in found)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("fault", ("sound", "weak"))
@pytest.mark.parametrize("name", VEHICLES)
def test_a_vehicle_that_holds_its_place_answers(name, fault, seed):
    """Half of the episodes hold a position within centimetres while the commands go on."""
    assert not find_stillness(flown(name, fault, seed), load_vehicle(name), SETTINGS)


def test_what_is_left_out_is_not_trusted():
    """A channel that stands still all along is gone; of another one, the stretch weighs nothing."""
    log = flown("paper")
    rest = without(log, [Stillness("z"), Stillness("yaw", 1, 5.0, 9.0)])
    assert rest is not None and rest.axes == ("x", "y", "yaw")
    masks = [episode.filled for episode in rest.episodes]
    assert [mask is None for mask in masks] == [True, False, True, True]
    mask = np.asarray(masks[1])
    assert mask[:, 5].sum() == pytest.approx(4.0 / 0.05, abs=2)
    assert not np.delete(mask, 5, axis=1).any()
    assert without(log, [Stillness(axis) for axis in log.axes]) is None


def test_channels_are_named_as_people_name_them():
    """Those that belong together are one word, in the order of the log."""
    assert named(["yaw", "z", "y", "x"]) == "position, depth and heading"
    assert named(["x"]) == "north position"
    (finding,) = tell([Stillness("z", 2, 8.2, 19.9)], False, 4)
    assert finding.sentence.startswith("from 8 s to 20 s of episode 2 depth does not answer to any command")


def test_what_stands_still_again_and_again_is_one_finding():
    """Stretches of several episodes are one sentence, and those of the same seconds one clause."""
    stretches = [Stillness("z", 2, 8.2, 30.0), *(Stillness("z", episode, 0.0, 30.0) for episode in (3, 4, 6))]
    (finding,) = tell(stretches, False, 6)
    assert finding.sentence.startswith(
        "from 8 s to 30 s of episode 2 and from 0 s to 30 s of episodes 3, 4 and 6 depth does not answer"
    )
    yaw = Stillness("yaw", 5, 2.0, 20.0)
    assert [one.columns for one in tell([*stretches, yaw], False, 6)] == [("z",), ("yaw",)]


def test_a_stuck_depth_gauge_is_told_before_the_fault_that_would_look_the_same():
    """A thruster that pushes against its partner is the other reading, at no more than one half, and is not advised."""
    paper = hold(load_vehicle("paper"))
    diagnosis = diagnose(stuck(fly(paper, {}, seed=1, episodes=3, seconds=20.0), ("z",)), paper)
    assert diagnosis.verdict is Verdict.CANNOT_TELL and told(diagnosis) == [("z",)] and not likely(diagnosis)
    begins = "Depth does not answer to any command: look at the sensor, or the vehicle floats or stands. Or else, "
    assert diagnosis.summary.startswith(begins)
    assert max(one.probability for one in diagnosis.candidates if one.name == "thruster_gain") <= 0.5
    console = summary_table(diagnosis)
    assert console.startswith(
        "cannot tell: Depth does not answer to any command.\n\nwhat to do\n  1. Look at the source"
    )
    assert "Look at the source of the depth" in console and "exchange two" not in console


def test_a_vehicle_that_stands_on_deck_is_told_so():
    """Nothing moves: no thruster is named."""
    paper = hold(load_vehicle("paper"))
    log = stuck(fly(paper, {}, seed=2, episodes=3, seconds=14.0), ("x", "y", "z", "yaw"))
    diagnosis = diagnose(log, paper)
    assert diagnosis.summary.startswith("The vehicle does not move at all, whatever is commanded: ")
    assert diagnosis.verdict is Verdict.CANNOT_TELL and not diagnosis.effects and diagnosis.gap.closed is None


def test_what_was_flown_is_explained_beside_what_was_held():
    """A dive with a weak thruster goes on after the vehicle is back on deck: both are told, and no sensor is blamed."""
    vehicle = load_vehicle("bluerov2_heavy")
    axes = ("x", "y", "z", "roll", "pitch", "yaw")
    log = fly(vehicle, {"thruster_gain": {"gain_2": 0.5}}, seed=2, episodes=2, seconds=40.0, axes=axes)
    diagnosis = diagnose(stuck(log, axes, stretch=(24.0, 40.0)), vehicle)
    assert diagnosis.headline.startswith("The vehicle does not move at all for a while, whatever is commanded")
    (told_so,) = (finding for finding in diagnosis.findings if finding.code == "stands")
    times = [float(one) for one in re.findall(r"from (\d+) s to (\d+) s", told_so.sentence)[0]]
    assert times == pytest.approx([24.0, 40.0], abs=1.0)
    (effect,) = diagnosis.effects
    assert effect.parameters["gain_2"].value == pytest.approx(0.5, abs=0.02)
    assert diagnosis.verdict is Verdict.EXPLAINED
    assert not any(finding.code == "does_not_answer" for finding in diagnosis.findings)


@pytest.mark.parametrize("moving", ["", "roll", "x"])
def test_a_vehicle_is_held_only_where_all_channels_stand_still(moving):
    """Where roll or a position goes on as it did, nothing is left out as held."""
    vehicle = load_vehicle("bluerov2_heavy")
    axes = ("x", "y", "z", "roll", "pitch", "yaw")
    log = fly(vehicle, {}, seed=2, episodes=2, seconds=40.0, axes=axes)
    parked = stuck(log, tuple(axis for axis in axes if axis != moving), stretch=(24.0, 40.0))
    found = find_held(parked, vehicle, SETTINGS, find_stillness(parked, vehicle, SETTINGS))
    assert {one.channel for one in found} == (set() if moving else set(axes))
    for number in {one.episode for one in found if one.episode is not None}:
        left = beside(parked, found)
        assert left is not None and left.only([number]).duration == pytest.approx(24.0, abs=1.0)


def test_a_vehicle_that_rocks_on_a_boat_while_its_thrusters_turn_does_not_move(monkeypatch):
    """Though no channel stands still: no thruster is named or located, no file corrected, and nothing is searched."""
    vehicle = hold(load_vehicle("bluerov2"))
    log = rocked(fly(vehicle, {}, seed=2, episodes=2, seconds=24.0))
    assert not is_whole(find_stillness(log, vehicle, SETTINGS), log)
    monkeypatch.setattr("auv_torchrl.diagnosis.explain.correct_file", None)
    diagnosis = diagnose(log, vehicle, uncertainty=load_uncertainty("bluerov2", vehicle))
    assert diagnosis.headline == "The vehicle does not move with its commands."
    assert diagnosis.summary.startswith("The vehicle does not move with its commands (")
    assert [one.called for one in diagnosis.alternatives] == ["the vehicle does not move with its commands"]
    assert diagnosis.where == Where()
    assert diagnosis.verdict is Verdict.CANNOT_TELL and not diagnosis.effects and diagnosis.next_experiment is None


def is_whole(still, log):
    """Whether every channel stands still all along."""
    return set(log.axes) <= {entry.channel for entry in still if entry.episode is None}


@pytest.mark.parametrize("fault", [{}, {"thruster_gain": {"gain_1": 0.0, "gain_2": 0.0, "gain_4": 0.0}},
                                   {"thruster_gain": {"gain_3": -1.0}}])  # fmt: skip
def test_a_vehicle_that_swims_is_not_taken_for_one_on_deck(fault):
    """Nor with half of its thrusters dead, nor beside a file that is three times as strong."""
    vehicle = hold(load_vehicle("bluerov2"))
    log = fly(vehicle, fault, seed=1, episodes=2, seconds=24.0)
    for file in (vehicle, changed(vehicle, gain=3 * vehicle.gain)):
        assert hardly_moves(log, file, SETTINGS) is None


@pytest.mark.thorough
@pytest.mark.slow
def test_a_fault_that_other_channels_show_is_named_beside_what_does_not_answer():
    """A weak thruster shows in position and heading; the depth gauge is stuck all the same."""
    paper = hold(load_vehicle("paper"))
    diagnosis = diagnose(stuck(fly(paper, FAULT, seed=3, episodes=3, seconds=20.0), ("z",)), paper)
    assert told(diagnosis) == [("z",)] and diagnosis.verdict is Verdict.PARTLY_EXPLAINED
    assert [(effect.name, effect.thrusters) for effect in likely(diagnosis)] == [("thruster_gain", (1,))]


@pytest.mark.slow
def test_dead_thrusters_that_other_channels_show_are_no_stuck_sensor():
    """The attitude shows that both vertical thrusters are dead, so that depth stands still: it answers."""
    blue = load_vehicle("bluerov2")
    axes = ("x", "y", "z", "roll", "pitch", "yaw")
    dead = {"thruster_gain": {"gain_5": 0.0, "gain_6": 0.0}}
    diagnosis = diagnose(fly(blue, dead, seed=3, episodes=3, seconds=20.0, axes=axes), blue)
    assert not told(diagnosis)
    assert {i for effect in likely(diagnosis) for i in effect.thrusters} == {5, 6}


@pytest.mark.thorough
@pytest.mark.slow
def test_beside_a_healthy_flight_a_stuck_depth_gauge_is_told_too():
    """The healthy flight measures depth, and the log to explain does not follow it."""
    paper = hold(load_vehicle("paper"))
    healthy = fly(paper, {}, seed=5, episodes=3, seconds=20.0)
    diagnosis = diagnose(stuck(fly(paper, {}, seed=1, episodes=3, seconds=20.0), ("z",)), paper, [healthy])
    assert told(diagnosis) == [("z",)] and not likely(diagnosis)


@pytest.mark.thorough
@pytest.mark.parametrize("name", COLUMNS)
def test_field_files_that_stand_still_are_told(name):
    """Each of them names its columns, and no fault of the vehicle."""
    paper = load_vehicle("paper")
    diagnosis = diagnose(read_flightlog(shared(f"field/{name}.csv"), paper), paper)
    assert told(diagnosis) == [COLUMNS[name]] and not likely(diagnosis)
    assert diagnosis.verdict is Verdict.CANNOT_TELL


@pytest.mark.thorough
@pytest.mark.parametrize("group", GROUPS)
@pytest.mark.parametrize("size", (0.3, 3.0))
@pytest.mark.parametrize("name", VEHICLES)
def test_no_size_of_noise_makes_a_fault_of_what_stands_still(name, size, group):
    """Each group of channels, on each vehicle held level: told with its columns, and no fault beside it."""
    vehicle = hold(load_vehicle(name))
    log = fly(vehicle, {}, seed=7, episodes=4, seconds=20.0)
    columns = tuple(channel for channel in log.axes if channel in GROUPS[group])
    diagnosis = diagnose(stuck(log, columns, size), vehicle)
    assert told(diagnosis) == [columns] and not likely(diagnosis)


@cache
def dives(episodes, sensors="mocap"):
    """Two flights of a sound vehicle with eight thrusters, by pilots who use all of them."""
    axes = sensor_set(sensors).axes
    cases = [Case(number, "sound", axes=axes, sensors=sensors, episodes=episodes) for number in (1, 2)]
    heavy = load_vehicle("bluerov2_heavy")
    return [as_read(log, heavy) for log, _ in fly_cases(cases, heavy, 11, ACTS)]


def of_another_dive(channels, episodes, sensors="mocap"):
    """The first of the two flights, channels of which are those of the second from the second episode on."""
    log, other = dives(episodes, sensors)
    columns, changed = [POSE.index(channel) for channel in channels], [log.episodes[0]]
    for episode, strange in zip(log.episodes[1:], other.episodes[1:], strict=True):
        pose = episode.pose.copy()
        pose[:, columns] = strange.pose[:, columns]
        changed.append(replace(episode, pose=pose))
    return replace(log, episodes=tuple(changed))


def posed(log):
    """The problem of a log of that vehicle."""
    heavy = load_vehicle("bluerov2_heavy")
    return Problem.of(cut_windows(log, SETTINGS.window_s, SETTINGS.lead_s, SETTINGS.bin_s), heavy, SETTINGS)


def suspects(log):
    """Channels that may be of another source, the likeliest first."""
    return find_other_source(*follow_windows(posed(log)))


def test_the_thrust_does_not_show_in_a_channel_of_another_dive():
    """A false heading makes positions false, too, from the second episode on; a sound vehicle answers throughout."""
    assert not suspects(dives(4)[0])
    (one,) = suspects(of_another_dive(("yaw",), 4))
    assert one.channels == ("x", "y", "yaw") and {entry.episode for entry in one.stretches} >= {1, 2, 3}


def test_what_a_part_of_a_log_suspects_all_of_it_clears_or_confirms():
    """A sound heading is cleared; one of another dive is false in held-out flight, too."""
    channels = ("x", "y", "yaw")
    suspect = Suspect(tuple(Stillness(name, 2, 10.0, np.inf) for name in channels), contradicts=False)

    def asked_of(log):
        return in_all_flight(suspect, log, posed(log), Explanation(), SETTINGS)

    assert asked_of(dives(4)[0]) is None
    confirmed = asked_of(of_another_dive(("yaw",), 4))
    assert confirmed is not None and confirmed.channels == channels
    assert {entry.episode for entry in confirmed.stretches} >= {1, 2, 3}


def test_the_thrust_shows_in_no_channel_of_a_replayed_pose():
    """Then the whole log is in doubt, from the second episode on."""
    (one,) = suspects(of_another_dive(POSE, 4))
    assert one.channels == POSE and {entry.episode for entry in one.stretches} >= {1, 2, 3} and not one.contradicts


@pytest.mark.parametrize(("channel", "sensors"), [("z", "dvl"), ("yaw", "dvl"), ("z", "stock")])
def test_a_channel_that_contradicts_another_of_the_same_motion_is_suspected(channel, sensors):
    """Depth against heave speed or specific force, heading against yaw rate, though the thrust shows in the other."""
    assert not suspects(dives(2, sensors)[0])
    found = suspects(of_another_dive((channel,), 2, sensors))
    assert (channel,) in [one.channels for one in found if one.contradicts]


def test_a_false_channel_outweighs_what_a_file_has_wrong():
    """Without it far less is left than without the other one that it contradicts, though not all is explained."""
    log, heavy = of_another_dive(("yaw",), 2, "dvl"), load_vehicle("bluerov2_heavy")
    gain = np.ones(heavy.thrusters)
    gain[2] = 0.75
    other = changed(heavy, gain=heavy.gain / gain)  # the thruster that flew gives 0.75 times what this vehicle's does
    problem = Problem.of(cut_windows(log, SETTINGS.window_s, SETTINGS.lead_s, SETTINGS.bin_s), other, SETTINGS)
    left = {}
    for suspect in find_other_source(*follow_windows(problem)):
        others = without(log, [Stillness(name) for name in suspect.channels])
        if suspect.contradicts and others is not None:
            left[suspect.channels] = left_by(others, problem, SETTINGS)
    least, *more = sorted(left, key=lambda channels: left[channels].excess)
    assert least == ("yaw",) and more and not left[least].is_nothing
    assert left[least].excess < FAR_LESS * min(left[one].excess for one in more)


@pytest.mark.thorough
@pytest.mark.parametrize("channel", ["z", "yaw"])
def test_which_of_two_that_contradict_each_other_is_false_is_told(channel):
    """The one without which all others show the vehicle as it should be; nothing is said of the thrusters."""
    diagnosis = diagnose(of_another_dive((channel,), 4, "dvl"), load_vehicle("bluerov2_heavy"))
    assert told(diagnosis) == [(channel,)] and not likely(diagnosis) and diagnosis.verdict is Verdict.CANNOT_TELL


def test_a_false_heading_is_told_although_the_rest_has_no_explanation():
    """A file whose thrust is a third too small, and nothing that is tried explains that."""
    heavy = load_vehicle("bluerov2_heavy")
    tried = replace(SETTINGS, ignored=tuple(EFFECTS.keys() - {"payload"}))
    diagnosis = diagnose(of_another_dive(("yaw",), 4, "dvl"), changed(heavy, gain=0.7 * heavy.gain), settings=tried)
    assert told(diagnosis) == [("yaw",)] and not likely(diagnosis) and diagnosis.verdict is Verdict.UNEXPLAINED


@pytest.mark.thorough
@pytest.mark.parametrize("is_guess", [False, True])
def test_a_replayed_pose_is_told_before_any_fault(is_guess):
    """Nothing that was measured is of this dive, and nothing is said of the thrusters; or of a file that is a guess."""
    heavy = load_vehicle("bluerov2_heavy")
    uncertainty = load_uncertainty("bluerov2_heavy", heavy) if is_guess else ()
    diagnosis = diagnose(of_another_dive(POSE, 4), heavy, uncertainty=uncertainty)
    assert [set(columns) for columns in told(diagnosis)] == [set(POSE)] and not likely(diagnosis)
    assert diagnosis.verdict is Verdict.CANNOT_TELL and "nothing of what the thrusters should do" in diagnosis.summary


@pytest.mark.thorough
def test_a_channel_of_another_dive_is_told_before_any_fault():
    """It moves as a vehicle does, but not as this one; nothing is said of the thrusters."""
    diagnosis = diagnose(of_another_dive(("yaw",), 4), load_vehicle("bluerov2_heavy"))
    assert told(diagnosis) == [("yaw",)] and not likely(diagnosis) and diagnosis.verdict is Verdict.CANNOT_TELL
    assert "on heading does not follow the vehicle" in diagnosis.summary
    assert [one.probability for one in diagnosis.alternatives] == [1.0]  # no fault explains it


@pytest.mark.thorough
def test_an_unknown_force_is_no_channel_of_another_dive():
    """Depth goes with the water, and with the thrusters too."""
    vehicle = hold(load_vehicle("bluerov2_heavy"))

    def swell(commands, position, velocity, t):
        force = np.zeros_like(position)
        force[:, 2] = 15.0 * np.sin(3.0 * t + 2.0 * position[:, 0])
        return commands, force

    diagnosis = diagnose(fly(vehicle, {}, seed=1, episodes=3, seconds=20.0, push=swell), vehicle)
    assert not told(diagnosis)
