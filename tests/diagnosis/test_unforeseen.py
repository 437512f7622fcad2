"""Held-out flight is fit by what sound flights of the same vehicle miss, and by nothing more."""

import numpy as np
import pytest
from flown_logs import fly, hold

from auv_torchrl.diagnosis.calibrate.calibration import calibrate
from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.diagnosis.thresholds import STILL_FAR
from auv_torchrl.diagnosis.validate.predict import predict, unforeseen, widened
from auv_torchrl.diagnosis.validate.veto import scaled_errors
from auv_torchrl.vehicle import load_vehicle

HELD = hold(load_vehicle("paper"))
SETTINGS = load_settings()


def gusts(seed: int, steady: float = 0.0):
    """Pushes in the earth frame, N, that change at random every half a second, and a steady one to the north."""
    table = np.random.default_rng(seed).normal(0, 1.0, (200, 3))

    def push(commands, position, velocity, t):
        force = np.zeros_like(position)
        force[..., :2] = table[int(2 * t), :2]
        force[..., 0] += steady
        return commands, force

    return push


@pytest.fixture(scope="module")
def healthy():
    return [fly(HELD, {}, seed=seed, episodes=3, seconds=20.0, push=gusts(seed)) for seed in (1, 2)]


@pytest.fixture(scope="module")
def sound(healthy):
    return calibrate(healthy, HELD, SETTINGS)


@pytest.mark.thorough
@pytest.mark.parametrize(("steady", "is_foreseen"), [(0.0, True), (3.0, False)])
def test_what_sound_flights_miss_is_no_gap_and_nothing_else_is(healthy, sound, steady, is_foreseen):
    """Gusts that healthy flights show make no gap of a sound flight; a steady push that they lack remains one."""
    log = fly(HELD, {}, seed=9, episodes=3, seconds=20.0, push=gusts(9, steady))
    floor = sound.prior.floor[[0, 1, 2, 5]]
    bare = predict(log, [sound.vehicle], SETTINGS, sound.prior.noise, 4 * floor)
    (before,), (error,) = (scaled_errors(p) for p in (bare, widened(bare, unforeseen(healthy, sound, SETTINGS))))
    assert before > STILL_FAR
    assert bool(error < STILL_FAR) is is_foreseen


def test_without_healthy_flights_the_floor_is_that_of_the_sensors():
    """Nothing is added where no flight tells, as behind a vehicle file that was kept."""
    sound = calibrate([fly(HELD, {}, seed=1, episodes=2, seconds=12.0)], HELD, SETTINGS)
    assert unforeseen((), None, SETTINGS) == {}
    assert unforeseen((), sound, SETTINGS) == {}
    log = fly(HELD, {}, seed=9, episodes=1, seconds=10.0)
    bare = predict(log, [HELD], SETTINGS, sound.prior.noise, np.full(4, 0.5))
    assert np.array_equal(widened(bare, {}).spread, bare.spread)
