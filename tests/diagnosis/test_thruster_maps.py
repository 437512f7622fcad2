"""Thrusters that push one way only, or push at rest: what they do, and that they are found with their values."""

from dataclasses import replace

import numpy as np
import pytest
from flown_logs import fly, hold
from hypothesis import given
from hypothesis import strategies as st

from auv_torchrl.diagnosis import Verdict, diagnose
from auv_torchrl.diagnosis.calibrate.parameters import load_uncertainty
from auv_torchrl.diagnosis.identify.following import follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.search import search
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.effects import EFFECTS
from auv_torchrl.effects.advice import neutral_offset
from auv_torchrl.flightlog import read_flightlog
from auv_torchrl.physics import ActiveTerms, prepare
from auv_torchrl.physics.thrusters import thrust_target
from auv_torchrl.vehicle import Vehicle, load_vehicle
from tests.flightlog.shared_data import shared

PAPER, HEAVY = load_vehicle("paper"), load_vehicle("bluerov2_heavy")
SETTINGS = load_settings()
POSE = ("x", "y", "z", "roll", "pitch", "yaw")
HALF = 1800  # samples, 90 s, of a log that is that long or longer


def thrusts(vehicle: Vehicle, commands: np.ndarray) -> np.ndarray:
    """Targets (K, n) of one vehicle at commands (K,), the same for all thrusters."""
    c = prepare(vehicle.expand(1)).numpy()
    return thrust_target(c, ActiveTerms.of(c), np.repeat(commands[:, None], vehicle.thrusters, axis=1))


@given(st.sampled_from([("forward_gain", 1), ("reverse_gain", -1)]), st.floats(-1.0, 2.0))
def test_a_gain_of_one_way_scales_the_thrust_of_that_way_alone(of, gain):
    """Of one thruster, after its limit; the other way and all others push as before."""
    name, way = of
    commands = np.linspace(-1.0, 1.0, 41)
    before, after = thrusts(HEAVY, commands), thrusts(EFFECTS[name].apply(HEAVY, {"gain_3": gain}), commands)
    factor = np.where(np.sign(commands) == way, gain, 1.0)
    np.testing.assert_allclose(after[:, 2], factor * before[:, 2], rtol=1e-12)
    np.testing.assert_array_equal(np.delete(after, 2, 1), np.delete(before, 2, 1))


@given(st.floats(-0.5, 0.5))
def test_a_thruster_rests_at_its_neutral(offset):
    """Its whole map is moved along the commands, and ends where they do."""
    moved = thrusts(EFFECTS["neutral_offset"].apply(HEAVY, {"offset_2": offset}), np.linspace(-1.0, 1.0, 41))[:, 1]
    expected = thrusts(HEAVY, np.clip(np.linspace(-1.0, 1.0, 41) - offset, -1.0, 1.0))[:, 1]
    np.testing.assert_allclose(moved, expected, atol=1e-12)


def found(vehicle, values, seed, axes, effects):
    """What a search among some effects finds in a short flight: values of terms by effect and first member."""
    log = fly(vehicle, values, seed=seed, episodes=2, seconds=20.0, axes=axes)
    settings = replace(SETTINGS, ignored=tuple(name for name in EFFECTS if name not in effects))
    problem = Problem.of(cut_windows(log, settings.window_s, settings.lead_s, settings.bin_s), vehicle, settings)
    best = search(*follow_windows(problem), lambda *_: None).best
    return {(term.effect, member): term.value for term in best.explanation.terms for member in term.members}


RIVALS = ("forward_gain", "reverse_gain", "neutral_offset", "thruster_gain", "thrust_limit", "thrust_curve")


@pytest.mark.parametrize(
    "values",
    [
        {"reverse_gain": {"gain_2": 0.0, "gain_4": 0.4}},
        pytest.param({"forward_gain": {"gain_3": 0.0}}, marks=pytest.mark.thorough),
        pytest.param({"neutral_offset": {"offset_4": -0.15}}, marks=pytest.mark.thorough),
        {"neutral_offset": {"offset_1": 0.1, "offset_3": 0.1}},
    ],
    ids=lambda values: "+".join(values),
)
def test_a_simulated_map_is_recovered(values):
    """Thrusters, way and values, among all that bends a thrust curve; vertical ones of a level vehicle are alike."""
    vehicle = hold(PAPER)
    terms = found(vehicle, values, 3, ("x", "y", "z", "yaw"), RIVALS)
    expected = {(effect, member): value for effect, row in values.items() for member, value in row.items()}
    assert terms.keys() == expected.keys()
    for member, value in expected.items():
        assert terms[member] == pytest.approx(value, abs=0.03)


@pytest.mark.parametrize(
    ("name", "effect", "values"),
    [
        ("s11_hold_oneway6", "reverse_gain", {"gain_6": 0.0}),
        pytest.param(
            "s4_creep23", "neutral_offset", {"offset_2": -0.12, "offset_3": -0.12}, marks=pytest.mark.thorough
        ),
    ],
)
def test_a_log_from_another_simulator_names_the_thruster(name, effect, values):
    """With its value, and nothing beside it; also where the file of the vehicle is a guess, as it says."""
    log = read_flightlog(shared(f"field/{name}.csv"), HEAVY)
    log = replace(log, episodes=(log.episodes[0].rows(0, HALF),))
    diagnosis = diagnose(log, HEAVY, uncertainty=load_uncertainty("bluerov2_heavy", HEAVY))
    assert diagnosis.verdict is Verdict.EXPLAINED
    (its,) = diagnosis.effects
    assert its.name == effect and its.parameters.keys() == values.keys() and its.probability > 0.9
    for member, value in values.items():
        assert its.parameters[member].value == pytest.approx(value, abs=0.02)


def test_one_cause_that_explains_all_is_not_taken_up_by_a_file_that_is_a_guess():
    """Many coefficients that are free together would fit a part of what one thruster does."""
    vehicle = hold(HEAVY)
    uncertain = load_uncertainty("bluerov2_heavy", HEAVY)
    log = fly(vehicle, {"reverse_gain": {"gain_2": 0.0}}, seed=5, episodes=3, seconds=20.0)
    diagnosis = diagnose(log, vehicle, uncertainty=uncertain)
    assert [(e.name, e.thrusters, e.calibrates) for e in diagnosis.effects] == [("reverse_gain", (2,), False)]
    assert diagnosis.verdict is Verdict.EXPLAINED and diagnosis.effects[0].probability > 0.9


def test_the_pulse_of_a_neutral_is_told_where_the_direction_is_known():
    """ArduSub sends 1500 us at rest and 400 us more or less at full command, by the direction of the motor."""
    known, unknown = neutral_offset({"offset_2": -0.1, "offset_3": -0.1}, {"MOT_2_DIRECTION": -1.0})
    assert "stands still at 1540 µs" in known.do and "SERVOn_TRIM" in known.do
    assert "40 µs beside 1500" in unknown.do
    (both,) = neutral_offset({"offset_2": -0.1, "offset_3": -0.1}, {})
    assert both.do.startswith("thrusters 2, 3 stand still at 40 µs beside 1500: set the trim of their outputs")
