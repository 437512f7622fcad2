"""Vehicles that change while they fly."""

from dataclasses import replace

import pytest
from flown_logs import fly, hold
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from auv_torchrl.diagnosis import diagnose
from auv_torchrl.diagnosis.identify.before_effects import find_onset
from auv_torchrl.diagnosis.identify.following import follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.vehicle import load_vehicle

PAPER = load_vehicle("paper")
HELD = hold(PAPER)


@pytest.mark.slow
@settings(max_examples=2, phases=[Phase.generate])  # to shrink an example takes minutes
@given(st.integers(1, 6), st.floats(0.2, 0.6), st.floats(16.0, 34.0), st.integers(0, 1000))
def test_a_thruster_that_weakens_in_flight_is_named_with_the_time(thruster, gain, onset_s, seed):
    """Whichever, however much and whenever: the part behind the onset has its gain, dated to within a window.

    The two vertical thrusters do the same to a vehicle whose roll is held, so that either may be named for the other.
    """
    log = fly(HELD, {"thruster_gain": {f"gain_{thruster}": gain}}, seed, episodes=2, seconds=55.0, onset_s=onset_s)
    diagnosis = diagnose(replace(log, episodes=log.episodes[1:]), PAPER)
    (named,) = diagnosis.effects[0].thrusters
    assert named in ({5, 6} if thruster in {5, 6} else {thruster})
    assert diagnosis.effects[0].parameters[f"gain_{named}"].value == pytest.approx(gain, abs=0.05)
    assert diagnosis.where.onset_in_episode_s == pytest.approx(onset_s, abs=2.5)


@pytest.mark.slow
def test_a_fault_that_was_there_before_the_pilot_woke_up_is_no_onset():
    """A log that holds still first and then moves has a fault from the start, which shows late only."""
    calm = fly(HELD, {"thruster_gain": {"gain_3": 0.4}}, seed=5, episodes=1, seconds=16.0)
    lively = fly(HELD, {"thruster_gain": {"gain_3": 0.4}}, seed=6, episodes=4, seconds=16.0)
    episodes = (*calm.episodes, *lively.episodes[1::2])
    log = replace(calm, episodes=tuple(replace(e, number=i) for i, e in enumerate(episodes)))
    diagnosis = diagnose(log, PAPER)
    assert diagnosis.effects[0].thrusters == (3,)
    assert diagnosis.where.onset_s is None


@pytest.mark.parametrize(("fault", "is_onset"), [(True, False), (False, True)])
def test_the_moment_at_which_a_vehicle_sets_in_is_no_onset(fault, is_onset):
    """A fault shows from where a vehicle moves on, and is dated only where it had moved before."""
    values = {"thruster_gain": {"gain_3": 0.3}}
    still, after = (fly(HELD, values, seed=seed, episodes=4, seconds=24.0) for seed in (5, 6))
    before = fly(HELD, {}, seed=7, episodes=4, seconds=24.0)
    first = [_settled(e) for e in still.episodes[::2]] if fault else before.episodes[1::2]
    episodes = tuple(replace(e, number=i) for i, e in enumerate((*first, *after.episodes[1::2])))
    settings = load_settings()
    windows = cut_windows(replace(after, episodes=episodes), settings.window_s, settings.lead_s, settings.bin_s)
    assert (find_onset(*follow_windows(Problem.of(windows, HELD, settings))) is not None) == is_onset


def _settled(episode):
    """The last half of an episode that holds its place."""
    half = len(episode.t) // 2
    t = episode.t[half:] - episode.t[half]
    rows = {name: getattr(episode, name)[half:] for name in ("pose", "velocity", "commands")}
    return replace(episode, t=t, **rows)
