"""Vehicles that change while they fly."""

from dataclasses import replace

import numpy as np
import pytest
from flown_logs import fly, hold

from auv_torchrl.diagnosis import diagnose
from auv_torchrl.vehicle import load_vehicle

PAPER = load_vehicle("paper")
HELD = hold(PAPER)


@pytest.mark.slow
def test_a_thruster_that_weakens_in_flight_is_named_with_the_time():
    """The part behind the onset is explained by the thruster, and the onset is dated to within a window."""

    def weaken(commands, position, velocity, t):
        changed = commands.copy()
        changed[:, 1] *= 0.4 if t > 21.0 else 1.0
        return changed, np.zeros_like(position)

    log = fly(HELD, {}, seed=3, episodes=2, seconds=55.0, push=weaken)
    diagnosis = diagnose(replace(log, episodes=log.episodes[1:]), PAPER)
    assert diagnosis.effects[0].thrusters == (2,)
    assert diagnosis.effects[0].parameters["gain_2"].value == pytest.approx(0.39, abs=0.05)
    assert diagnosis.where.onset_in_episode_s == pytest.approx(21.0, abs=2.5)


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
