"""Windows are followed by a free force, whatever is wrong of the vehicle that it pushes."""

from functools import cache

import pytest

from auv_torchrl.diagnosis.identify.following import follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.effects.effect import changed
from auv_torchrl.vehicle import load_vehicle
from benchmarks.blind.flights.cases import Case
from benchmarks.blind.flights.fly import fly as fly_cases
from benchmarks.blind.flights.sensor_sets import SENSOR_SETS, sensor_set
from benchmarks.owners.acts import ACTS
from tests.diagnosis.flown_logs import as_read

HEAVY, SETTINGS = load_vehicle("bluerov2_heavy"), load_settings()


@cache
def windows_of_a_dive(sensors):
    """A sound vehicle, by a pilot who uses all of its eight thrusters and turns at up to 4 rad/s."""
    case = Case(1, "sound", axes=sensor_set(sensors).axes, sensors=sensors, episodes=1)
    ((log, _),) = fly_cases([case], HEAVY, 11, ACTS)
    return cut_windows(as_read(log, HEAVY), SETTINGS.window_s, SETTINGS.lead_s, SETTINGS.bin_s)


@pytest.mark.parametrize("thrust", [1.0, 0.7])
@pytest.mark.parametrize("sensors", SENSOR_SETS)
def test_a_force_follows_every_window_of_a_sound_dive(sensors, thrust):
    """Whether the file has its thrust right or not: what it has wrong is a force, too."""
    vehicle = changed(HEAVY, gain=thrust * HEAVY.gain)
    problem, _ = follow_windows(Problem.of(windows_of_a_dive(sensors), vehicle, SETTINGS))
    assert problem.followed.all()
