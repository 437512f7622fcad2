"""Healthy flights tell whether a vehicle tilts, although nobody measured it."""

from dataclasses import replace

import pytest

from auv_torchrl.diagnosis.calibrate.calibration import calibrate
from auv_torchrl.diagnosis.identify.hypotheses import apply_values, load_settings
from auv_torchrl.vehicle import load_vehicle
from tests.diagnosis.flown_logs import fly, hold
from tests.diagnosis.healthy_flights import WRONG

SETTINGS = load_settings()
FREE = load_vehicle("paper")


@pytest.mark.thorough
@pytest.mark.parametrize("tilts", [True, False])
def test_healthy_flights_tell_whether_the_vehicle_tilts(tilts):
    """A hull that is heavy on one side tilts and one that is held does not, and neither looks like a disturbance."""
    own = apply_values(FREE if tilts else hold(FREE), {**WRONG, "mass_offset": {"x": 0.005, "y": 0.012}})
    flights = [replace(fly(own, {}, seed=seed, episodes=3, seconds=20.0), name=str(seed)) for seed in (1, 2)]
    sound = calibrate(flights, hold(FREE), SETTINGS, free=FREE.free)
    assert sound.tilts == tilts
    assert (sound.prior.floor[:3] < SETTINGS.floor_force[:3]).all()
