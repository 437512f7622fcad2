"""The rules of what is sent, each provoked, and 10,000 drawn flights with losses, delays and wild values."""

import math

import numpy as np
import pytest

from auv_torchrl.fly.motion import Clock
from auv_torchrl.fly.safety import (
    GIVE_UP_S,
    HEARTBEAT_S,
    NEUTRAL,
    SETTLED,
    STALE_S,
    End,
    Limits,
    Motion,
    Phase,
    Safety,
)

DT, MODE = 0.05, 19
LEVEL = (1.0, 0.0, 0.0, 0.0)
LIMITS = Limits(shallowest_m=0.3, deepest_m=10.0, radius_m=5.0, authority=0.8)
WANTED = (0.5, -0.5, 0.25, 2.0)


def at(time_s, position=(0.0, 0.0, 2.0), quaternion=LEVEL, velocity=(0.0,) * 6):
    """A measured state."""
    return Motion(time_s, position, quaternion, velocity)


@pytest.fixture
def flying():
    """A flight that has begun at 1 s."""
    safety = Safety(LIMITS, DT, MODE)
    safety.heartbeat(0.9, MODE, True)
    for n in range(SETTLED):
        safety.measured(0.9 + 0.02 * n, at(0.9 + 0.02 * n))
    safety.measured(1.0, at(1.0))
    assert safety.begin(1.0)
    return safety


def test_a_command_is_kept_within_its_limits(flying):
    """And holds until the measurement that it follows from is 0.5 s old."""
    decision = flying.decide(1.0, WANTED)
    assert decision == ((0.5, -0.5, 0.25, 0.8), Phase.FLYING, 1.0 + STALE_S)


@pytest.mark.parametrize("missing", ["armed", "mode", "heartbeat", "settled"])
def test_nothing_is_flown_before_all_that_a_flight_needs_is_there(missing):
    """Armed, in its mode, heard, and measured several times in a row."""
    safety = Safety(LIMITS, DT, MODE)
    if missing != "heartbeat":
        safety.heartbeat(0.0, 0 if missing == "mode" else MODE, missing != "armed")
    for n in range(SETTLED - (missing == "settled")):
        safety.measured(0.02 * n, at(0.02 * n))
    assert not safety.begin(0.1)
    assert safety.motion(0.1) is None
    assert safety.decide(0.1, WANTED)[:2] == (NEUTRAL, Phase.WAITING)


def test_an_old_measurement_makes_neutral_and_a_new_one_flies_on(flying):
    """Neutral before the step in which the measurement becomes 0.5 s old."""
    assert flying.decide(1.0 + STALE_S - DT, WANTED).phase is Phase.FLYING
    assert flying.decide(1.001 + STALE_S - DT, WANTED)[:2] == (NEUTRAL, Phase.STALE)
    flying.measured(2.0, at(2.0))
    assert flying.decide(2.0, WANTED).phase is Phase.FLYING


def test_without_measurements_the_flight_ends(flying):
    """After 3 s; a heartbeat alone does not help."""
    flying.heartbeat(3.9, MODE, True)
    flying.decide(1.0 + GIVE_UP_S + 0.01, WANTED)
    assert flying.ended is End.STALE
    flying.measured(4.1, at(4.1))
    assert flying.decide(4.1, WANTED)[:2] == (NEUTRAL, Phase.ENDED)


@pytest.mark.parametrize(
    "wild",
    [
        at(1.02, position=(math.nan, 0.0, 2.0)),
        at(1.02, position=(0.0, math.inf, 2.0)),
        at(1.02, position=(40.0, 0.0, 2.0)),
        at(1.02, velocity=(9.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
        at(1.02, velocity=(0.0, 0.0, 0.0, 0.0, 0.0, math.nan)),
        at(1.02, velocity=(0.0, 0.0, 0.0, 50.0, 0.0, 0.0)),
        at(1.02, quaternion=(0.0, 0.0, 0.0, 1.0)),
        at(1.02, quaternion=(0.0, 0.0, 0.0, 0.0)),
        at(7.0),
        at(math.nan),
    ],
)
def test_a_wild_measurement_makes_neutral_at_once(flying, wild):
    """Until one comes that can be true; one of the future too."""
    assert not flying.measured(1.02, wild)
    assert flying.motion(1.02) is None
    assert flying.decide(1.02, WANTED)[:2] == (NEUTRAL, Phase.WILD)
    flying.measured(1.04, at(1.04))
    assert flying.decide(1.04, WANTED).phase is Phase.FLYING


def test_a_repeated_measurement_is_no_newer(flying):
    """However often it comes: it becomes stale."""
    for n in range(30):
        flying.measured(1.0 + 0.02 * n, at(1.0))
    assert flying.decide(1.6, WANTED)[:2] == (NEUTRAL, Phase.STALE)


def test_a_lost_heartbeat_ends_the_flight(flying):
    """While measurements come on."""
    flying.measured(0.89 + HEARTBEAT_S, at(0.89 + HEARTBEAT_S))
    assert flying.decide(0.89 + HEARTBEAT_S, WANTED).phase is Phase.FLYING
    assert flying.decide(1.0 + HEARTBEAT_S, WANTED)[:2] == (NEUTRAL, Phase.ENDED)
    assert flying.ended is End.HEARTBEAT


@pytest.mark.parametrize(
    ("position", "why"),
    [((0.0, 0.0, 0.2), End.SHALLOW), ((0.0, 0.0, 10.1), End.DEEP), ((4.0, -3.1, 2.0), End.FAR)],
)
def test_a_limit_ends_the_flight(flying, position, why):
    """It does not go on when the vehicle comes back."""
    for step in range(1, 200):  # there at 2 m/s
        share = min(1.0, step / 190)
        place = tuple(a + share * (b - a) for a, b in zip((0.0, 0.0, 2.0), position, strict=True))
        now = 1.0 + 0.025 * step
        flying.heartbeat(now, MODE, True)
        assert flying.measured(now, at(now, place))
        flying.decide(now, WANTED)
    assert flying.ended is why
    assert flying.decide(6.0, WANTED).neutral


@pytest.mark.parametrize(("mode", "armed", "why"), [(2, True, End.MODE), (MODE, False, End.DISARMED)])
def test_another_mode_and_a_disarmed_vehicle_end_the_flight(flying, mode, armed, why):
    """Both are somebody else's will."""
    flying.heartbeat(1.01, mode, armed)
    assert flying.decide(1.02, WANTED).neutral and flying.ended is why


@pytest.mark.parametrize("wanted", [(math.nan, 0, 0, 0), (0, 0, math.inf, 0), (0, 0, 0), ()])
def test_a_policy_that_gives_no_number_ends_the_flight(flying, wanted):
    """Also one that gives too few."""
    assert flying.decide(1.0, wanted)[:2] == (NEUTRAL, Phase.ENDED)
    assert flying.ended is End.NOT_A_NUMBER


def test_the_first_reason_is_kept(flying):
    """What happens afterwards follows from it."""
    flying.end(End.ASKED)
    flying.end(End.CRASH)
    assert flying.ended is End.ASKED and flying.decide(1.0, WANTED).neutral


FLIGHTS, STEPS = 10_000, 16
GOOD, LOST, REPEATED, DELAYED, WILD = range(5)


def test_no_drawn_flight_has_a_command_outside_its_limits_or_later_than_half_a_second():
    """10,000 flights whose measurements are lost, late, repeated or wild, and whose policy wants anything.

    What is good, and when it was measured, is known here and not to the program.
    """
    draws = np.random.default_rng(0)
    shares = draws.dirichlet((3, 1, 0.5, 1, 0.5), FLIGHTS).cumsum(axis=1)
    kinds = (draws.random((FLIGHTS, STEPS, 1)) > shares[:, None, :4]).sum(axis=2).tolist()
    late, numbers = draws.exponential(0.2, (FLIGHTS, STEPS)).tolist(), draws.random((FLIGHTS, STEPS)).tolist()
    odd, size = draws.choice([math.nan, math.inf, 1e9, -1e9], (FLIGHTS, STEPS, 4)), (FLIGHTS, STEPS, 4)
    wanted = np.where(draws.random(size) < 0.02, odd, draws.normal(0, 1, size)).tolist()
    gaps = draws.integers(0, 4, FLIGHTS).tolist()
    flown = sum(map(drawn_flight, kinds, late, wanted, numbers, gaps))
    assert flown > FLIGHTS  # many commands were not neutral: the rules are not kept by doing nothing


def drawn_flight(kinds, late, wanted, numbers, gap):
    """One flight, a step every 0.05 s, with a pause of ``gap`` steps in its middle; how often it was not neutral."""
    safety, clock, now, newest = Safety(LIMITS, DT, MODE), Clock(), 10.0, 10.0
    for _ in range(SETTLED):
        now += 0.02
        assert safety.measured(now, at(clock.ours(now, now - 7.0)))
        newest = now
    safety.heartbeat(now, MODE, True)
    assert safety.begin(now)
    waiting, count = [], 0
    for step, kind in enumerate(kinds):
        now += DT * (1 + gap * (step == STEPS // 2))
        measured = now - 0.01
        if kind == GOOD:
            waiting.append((now, measured, True))
        elif kind == REPEATED:
            waiting.append((now, newest, True))
        elif kind == DELAYED:
            waiting.append((now + late[step], measured, True))
        elif kind == WILD:
            waiting.append((now, measured, False))
        for _, sampled, good in [entry for entry in waiting if entry[0] <= now]:
            place = (0.01 * sampled, 0.0, 2.0) if good else (wild_of(numbers[step]), 0.0, 2.0)
            safety.measured(now, at(clock.ours(now, sampled - 7.0), place))
            newest = max(newest, sampled) if good else newest
        waiting = [entry for entry in waiting if entry[0] > now]
        motion = safety.motion(now)
        decision = safety.decide(now, wanted[step] if motion is not None else None)
        assert all(math.isfinite(value) and abs(value) <= LIMITS.authority for value in decision.command)
        if not decision.neutral:
            count += 1
            assert now + DT <= newest + STALE_S + 1e-3  # it is held for a step
            assert decision.until_s <= newest + STALE_S + 1e-3  # by then the second process sends neutral
            assert kind != WILD
    return count


def wild_of(number):
    """A position that no vehicle can be at."""
    return (math.nan, math.inf, -math.inf, 1e9, -50.0, 40.0)[int(6 * number)]
