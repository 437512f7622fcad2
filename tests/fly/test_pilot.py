"""Whole flights in front of a stand-in of ArduSub that flies our simulator, on its clock."""

import json

import numpy as np
import pytest

from auv_torchrl.export.contract import write_export
from auv_torchrl.export.job import Asked, described
from auv_torchrl.flightlog import Severity, read_flightlog
from auv_torchrl.fly.channels import Interface
from auv_torchrl.fly.flyer import Flyer
from auv_torchrl.fly.keep import FLIGHT, REPORT, Keeper
from auv_torchrl.fly.known import UnknownVehicle
from auv_torchrl.fly.pilot import CannotFly, Pilot, Settings
from auv_torchrl.fly.safety import End, Limits, Motion
from auv_torchrl.link.plant import Start
from auv_torchrl.vehicle import load_vehicle
from tests.export.conftest import drawn
from tests.fly.double import STABILIZE, Vehicle, VirtualLink

LIMITS = Limits(shallowest_m=0.3, deepest_m=10.0, radius_m=5.0)


@pytest.fixture
def flown(exported):
    """Flies a vehicle; pilot and link, after the flight."""

    def fly(vehicle, stop=None, keeper=None, **settings):
        link, stop = VirtualLink(vehicle), stop or (lambda: vehicle.time_s > 150)
        settings = {"limits": LIMITS, "arm": True, "until_s": 2.0, **settings}
        pilot = Pilot(link, Flyer(exported), Settings(**settings), stop, keeper=keeper)
        pilot.fly()
        return pilot, link

    return fly


def at(time_s, **changes):
    """Changes a vehicle from a time on, in s since the first command that was not neutral."""
    begun = []

    def hook(vehicle):
        if not begun and vehicle.armed:
            begun.append(vehicle.time_s)
        if begun and vehicle.time_s - begun[0] >= time_s:
            for name, value in changes.items():
                setattr(vehicle, name, value)

    return hook


def is_neutral(inputs):
    """Whether all six are at their trim."""
    return set(inputs.values()) == {1500}


def as_found(vehicle, silent=False):
    """Whether it is disarmed, in the mode in which it was, and the last command, if there was any, was neutral."""
    ended = silent or is_neutral(vehicle.commands[-1][1])
    return not vehicle.armed and vehicle.mode == STABILIZE and ended


@pytest.mark.parametrize("interface", Interface)
def test_a_place_is_held_and_the_vehicle_left_as_it_was(flown, interface):
    """Where it was when the flight began, in mode MANUAL; neutral before and after."""
    vehicle = Vehicle(gain=0.5 if interface is Interface.RC else 1.0)
    pilot, _ = flown(vehicle, interface=interface, until_s=6.0)
    assert pilot.safety.ended is End.TIME and pilot.has_left and as_found(vehicle)
    assert np.linalg.norm(vehicle.place - (3.0, 0.0, 2.0)) < 0.2
    assert max(pilot.tally.off_m) < 0.15 and pilot.tally.flown_s > 5.9
    assert any(not is_neutral(inputs) for _, inputs in vehicle.commands)
    rate = len(pilot.tally.off_m) / pilot.tally.flown_s
    assert rate == pytest.approx(20.0, rel=0.02)


def test_it_begins_where_it_is_along_its_own_heading(exported):
    """A vehicle that is pushed to starboard is pushed back to port, whatever its heading."""
    flyer = Flyer(exported)
    for yaw in (0.0, 0.7, 3.0):
        quaternion = (np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2))
        flyer.start(Motion(0.0, (9.0, -4.0, 3.0), quaternion, (0.0,) * 6))
        starboard = np.array((-np.sin(yaw), np.cos(yaw), 0.0))
        there = tuple(np.array((9.0, -4.0, 3.0)) + 0.3 * starboard)
        command = flyer.command(Motion(0.1, there, quaternion, (0.0,) * 6))
        np.testing.assert_allclose(command, (0.0, -np.tanh(0.3), 0.0, 0.0), atol=1e-5)
        assert flyer.off(Motion(0.1, there, quaternion, (0.0,) * 6)) == pytest.approx(0.3)


def test_without_being_asked_it_does_not_arm(flown):
    """It waits for whoever arms, and leaves arming to them in the end."""
    vehicle = Vehicle()
    pilot, _ = flown(vehicle, arm=False, stop=lambda: vehicle.time_s > 106)
    assert pilot.safety.ended is End.ASKED and not vehicle.armed
    assert pilot.safety.begun is None and all(is_neutral(inputs) for _, inputs in vehicle.commands)

    def arms(vehicle):
        vehicle.armed = vehicle.time_s > 104

    vehicle = Vehicle(hook=arms)
    pilot, _ = flown(vehicle, arm=False, until_s=2.0)
    assert pilot.safety.ended is End.TIME and vehicle.armed and vehicle.mode == STABILIZE


def test_a_dry_run_sends_nothing(flown):
    """Not one byte; what it would have sent is worked out all the same."""
    vehicle = Vehicle()
    pilot, link = flown(vehicle, dry_run=True, arm=True)
    assert link.sent == b"" and not vehicle.others and not vehicle.commands and as_found(vehicle, silent=True)
    assert pilot.safety.ended is End.TIME and max(pilot.tally.off_m) > 0


CHANGES = {
    End.HEARTBEAT: {"says_heartbeat": False},
    End.STALE: {"says_position": False},
    End.MODE: {"mode": 2},
    End.DISARMED: {"armed": False},
    End.SHALLOW: {"lie": lambda place: [place[0], place[1], 0.2]},
    End.DEEP: {"lie": lambda place: [*place[:2], 10.2]},
    End.FAR: {"lie": lambda place: [place[0], place[1] + 5.2, place[2]]},
}


@pytest.mark.parametrize("why", CHANGES)
def test_each_rule_ends_the_flight_with_neutral(flown, why):
    """And the vehicle disarmed, in the mode in which it was found; where somebody chose a mode, that one stays."""
    vehicle = Vehicle(hook=at(1.0, **CHANGES[why]))
    wide = Limits(shallowest_m=0.3, deepest_m=10.0, radius_m=5.0, fastest_m_s=20.0)
    if why in (End.SHALLOW, End.DEEP, End.FAR):
        vehicle.start = Start(down={End.SHALLOW: 0.5, End.DEEP: 9.9}.get(why, 2.0))
        vehicle.lie = lambda place: place
        vehicle.__post_init__()
        vehicle.hook = at(1.0, **CHANGES[why])
        if why is End.FAR:  # it wanders off: no jump, which would be wild
            steps = iter(np.linspace(0, 8, 20))
            vehicle.hook = at(1.0, lie=lambda place: [place[0], place[1] + next(steps, 8), place[2]])
    pilot, _ = flown(vehicle, limits=wide, until_s=20.0)
    assert pilot.safety.ended is why
    assert is_neutral(vehicle.commands[-1][1])
    if why is End.MODE:
        assert vehicle.mode == 2 and vehicle.armed
    else:
        assert as_found(vehicle)


def neutral_after(vehicle, time_s):
    """Whether no command from ``time_s`` on was anything but neutral, and some came."""
    after = [inputs for when, inputs in vehicle.commands if when > time_s]
    return bool(after) and all(map(is_neutral, after))


@pytest.mark.parametrize("change", [{"says_position": False}, {"lie": lambda place: [np.nan, *place[1:]]},
                                    {"lie": lambda place: [place[0] + 30.0, *place[1:]]}])  # fmt: skip
def test_no_command_comes_later_than_half_a_second_after_the_last_good_state(flown, change):
    """Also where states that cannot be true go on coming; then at once."""
    vehicle, seen = Vehicle(hook=at(1.0, **change)), []
    vehicle.plant.simulator.state.velocity[0, 0] = 0.3  # it moves, so that there is something to do
    previous = vehicle.hook

    def watch(vehicle):
        previous(vehicle)
        if vehicle.lie is None and vehicle.says_position:
            seen[:] = [vehicle.time_s]

    vehicle.hook = watch
    flown(vehicle, until_s=20.0)
    assert not neutral_after(vehicle, seen[0] - 0.3)
    assert neutral_after(vehicle, seen[0] + (0.5 if "says_position" in change else 0.07))


@pytest.mark.parametrize("crash", [RuntimeError, KeyboardInterrupt])
def test_a_crash_of_its_own_ends_with_neutral_too(exported, crash):
    """The error is handed on, after the vehicle has been left as it was."""
    vehicle = Vehicle()
    flyer = Flyer(exported)
    pilot = Pilot(VirtualLink(vehicle), flyer, Settings(LIMITS, arm=True, until_s=20.0))
    command = flyer.command

    def fails(motion):
        if flyer.along_s > 0.5:
            raise crash("the policy is broken")
        return command(motion)

    flyer.command = fails
    with pytest.raises(crash):
        pilot.fly()
    assert pilot.safety.ended is End.CRASH and pilot.has_left and as_found(vehicle)


def test_a_policy_that_gives_no_number_ends_the_flight(exported):
    """As a broken file might."""
    vehicle, flyer = Vehicle(), Flyer(exported)
    flyer.command = lambda motion: [np.nan, 0.0, 0.0, 0.0]
    pilot = Pilot(VirtualLink(vehicle), flyer, Settings(LIMITS, arm=True, until_s=20.0))
    assert pilot.fly() is End.NOT_A_NUMBER and as_found(vehicle)
    assert all(is_neutral(inputs) for _, inputs in vehicle.commands)


def test_a_link_that_takes_no_more_and_a_second_process_that_ended_end_the_flight(exported):
    """Nobody would send neutral in our place, or what is sent arrives too late."""

    class Gone:
        def plan(self, neutral, ending):
            pass

        def beat(self, until_s):
            pass

        def alive(self):
            return False

    vehicle = Vehicle()
    pilot = Pilot(VirtualLink(vehicle), Flyer(exported), Settings(LIMITS, arm=True, until_s=20.0), guard=Gone())
    assert pilot.fly() is End.UNWATCHED and as_found(vehicle)
    vehicle = Vehicle()
    link = VirtualLink(vehicle)
    vehicle.hook = lambda vehicle: setattr(link, "full", vehicle.time_s > 106)
    pilot = Pilot(link, Flyer(exported), Settings(LIMITS, arm=True, until_s=20.0))
    assert pilot.fly() is End.BLOCKED and as_found(vehicle)


def test_an_autopilot_that_is_started_anew_ends_the_flight(flown):
    """Its clock goes back."""
    vehicle = Vehicle(hook=lambda vehicle: setattr(vehicle, "time_s", vehicle.time_s - 90 * (vehicle.time_s > 106)))
    pilot, _ = flown(vehicle, until_s=20.0)
    assert pilot.safety.ended is End.RESTARTED and is_neutral(vehicle.commands[-1][1])


REFUSED = {
    "autopilot": ({"kind": 2}, "type 2 with autopilot 3, a submarine"),
    "old": ({"version": (3, 6)}, "ArduSub 3.6, 4.1 to 4.7 are flown"),
    "new": ({"version": (4, 9)}, "ArduSub 4.9"),
    "frame": ({"parameters": {"FRAME_CONFIG": 4.0}}, "FRAME_CONFIG 4, flown are 1"),
    "thrusters": ({"parameters": {"FRAME_CONFIG": 1.0}}, "vectored, which has 6"),
    "station": ({"parameters": {"MAV_GCS_SYSID": 42.0}}, "obeys the ground station 42: give system=42"),
    "trim": ({"parameters": {"RC3_TRIM": 1100.0}}, "RC3_MIN, _TRIM and _MAX"),
    "silent": ({"parameters": {"RC3_TRIM": np.nan}}, "does not tell RC3_TRIM"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_nothing_is_done_on_a_vehicle_that_is_not_known(flown, case):
    """It is asked what it is, and neither moved nor armed nor put into another mode."""
    changes, says = REFUSED[case]
    vehicle = Vehicle(**changes)
    with pytest.raises(UnknownVehicle, match=says):
        flown(vehicle)
    assert "SET_MODE" not in vehicle.others and not vehicle.armed and vehicle.mode == STABILIZE
    assert not vehicle.commands


def test_a_version_that_the_user_has_tried_is_flown(flown):
    """By its name."""
    pilot, _ = flown(Vehicle(version=(4, 9)), firmware="4.9", until_s=0.5)
    assert pilot.safety.ended is End.TIME


def test_a_vehicle_that_does_not_arm_or_says_no_position_is_left_as_it_was(flown):
    """With what the vehicle says."""
    vehicle = Vehicle(refuses_to_arm=True)
    with pytest.raises(CannotFly, match="refused arming .*PreArm: leak detected"):
        flown(vehicle)
    assert as_found(vehicle)
    vehicle = Vehicle(says_position=False)
    with pytest.raises(CannotFly, match="no usable LOCAL_POSITION_NED and ATTITUDE came"):
        flown(vehicle)
    assert "SET_MODE" not in vehicle.others and not vehicle.armed


def test_what_is_kept_is_a_flight_log(flown, tmp_path):
    """That the diagnosis reads: motion as it was measured, and the four channels as the vehicle took them."""
    keeper = Keeper(tmp_path)
    vehicle = Vehicle()
    vehicle.plant.simulator.state.velocity[0, 0] = 0.3
    pilot, _ = flown(vehicle, keeper=keeper, until_s=3.0)
    keeper.close({"flown_s": pilot.tally.flown_s})
    log = read_flightlog(tmp_path / FLIGHT, load_vehicle("bluerov2_heavy"))
    assert not [finding for finding in log.findings if finding.severity is Severity.ERROR]
    (episode,) = log.episodes
    assert episode.duration == pytest.approx(3.0, abs=0.2)
    assert np.ptp(episode.commands) > 0.05
    assert json.loads((tmp_path / REPORT).read_text())["flown_s"] == pytest.approx(3.0, abs=0.1)


def test_what_the_export_has_learnt_of_a_changed_vehicle_is_flown(tmp_path):
    """As u_t, unless u_s is asked for; what commands thrusters one by one does not fit through ArduSub's inputs."""
    for kind in ("affine", "thrusters"):
        given = drawn("bluerov2_heavy", kind)
        (tmp_path / kind).mkdir()
        about = described(Asked(given.policy, given.task, given.vehicle, given.adapter, True))
        write_export(tmp_path / kind, *about)
    motion = Motion(0.0, (0.0, 0.3, 0.0), (1.0, 0.0, 0.0, 0.0), (0.1, 0.0, 0.0, 0.0, 0.0, 0.2))
    adapted, source = (Flyer(tmp_path / "affine", adapted=adapted) for adapted in (True, False))
    assert "u_t" in adapted.says and "u_s" in source.says
    assert adapted.command(motion) != pytest.approx(source.command(motion), abs=1e-3)
    with pytest.raises(ValueError, match="commands thrusters, and ArduSub takes surge, sway, heave and yaw alone"):
        Flyer(tmp_path / "thrusters")
