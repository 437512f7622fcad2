"""A dive part of which was flown at the surface, where the vehicle's file says where that lies."""

import numpy as np
import pytest
from flown_logs import AXES, DT, hold

from auv_torchrl.diagnosis import Verdict, diagnose
from auv_torchrl.diagnosis.identify.hypotheses import apply_values
from auv_torchrl.flightlog import Episode, FlightLog
from auv_torchrl.flightlog.checks.contact import leave_out_contact
from auv_torchrl.simulator import PlainSimulator, at_rest, record
from auv_torchrl.vehicle import load_vehicle, read_vehicle_file

SURFACE = -1.0  # m, above which there is air
FLOATS = hold(load_vehicle({**read_vehicle_file("paper"), "surface": SURFACE, "air": 1.0}))
HEAVE = [-0.3, -0.6, 0.4, -0.35, -0.7, 0.5, -0.2, -0.5]  # of full thrust, an eighth of the dive each: up, mostly


def dive(values, seconds: float = 60.0, seed: int = 0) -> FlightLog:
    """The vehicle, changed by effects, is pushed up into the surface and down again."""
    rng = np.random.default_rng(seed)
    count = round(seconds / DT)
    demand = np.repeat(rng.uniform(-0.4, 0.4, (count // 20 + 1, 4)), 20, axis=0)[:count] * (1.0, 1.0, 0.0, 0.3)
    demand[:, 2] = np.repeat(HEAVE, -(-count // len(HEAVE)))[:count]
    commands = np.clip(demand @ FLOATS.mixer[:, [0, 1, 2, 5]].T, -1, 1)
    simulator = PlainSimulator(apply_values(FLOATS, values).expand(1), DT)
    simulator.resume(at_rest(np.array([[0.0, 0.0, 1.0]]), np.zeros(1), FLOATS.thrusters))
    jitter = rng.standard_normal((count, 1, 6)) * np.repeat((0.002, 0.004), 3)

    def pilot(time, seen):
        return np.round(commands[[min(round(time / DT), count - 1)]], 4)

    flown = record(simulator, pilot, count, DT, jitter)
    pose = flown.measured[0]
    pose[:, 3:5] = np.nan
    t = DT * np.arange(count, dtype=float)
    return FlightLog("dive", (Episode(0, t, pose, np.full_like(pose, np.nan), flown.commands[0]),), AXES)


@pytest.mark.parametrize(
    ("values", "verdict"),
    [
        ({}, Verdict.NO_GAP),
        ({"buoyancy": {"force": -12.0}}, Verdict.EXPLAINED),
        pytest.param({"thruster_gain": {"gain_5": 0.3}}, Verdict.EXPLAINED, marks=pytest.mark.thorough),
    ],
    ids=str,
)
def test_a_dive_to_the_surface_is_diagnosed_as_any_other(values, verdict):
    """Nothing is left out; a sound vehicle is sound, and what is wrong with another one is named with its size."""
    log = dive(values)
    assert (
        log.episodes[0].pose[:, 2].min() < SURFACE + 0.52
    )  # its hull is 0.23 m high, and half a metre above the origin
    episodes, findings = leave_out_contact(log.episodes, FLOATS)
    assert episodes is log.episodes and not findings
    found = diagnose(log, FLOATS)
    assert found.verdict is verdict
    named = {effect.name: {key: p.value for key, p in effect.parameters.items()} for effect in found.effects}
    assert named == {effect: pytest.approx(given, abs=0.2) for effect, given in values.items()}


@pytest.mark.thorough
def test_the_same_surface_that_no_file_tells_is_no_sound_vehicle():
    """The log shows a force that stops it; it is not taken for a gap that is explained."""
    assert diagnose(dive({}), hold(load_vehicle("paper"))).verdict is Verdict.UNEXPLAINED
