"""Fins of a torpedo that do not do what they are told, from a log of its dive."""

import numpy as np
import pytest

from auv_torchrl.diagnosis import Verdict, diagnose
from auv_torchrl.diagnosis.motion.actuation import LAG_MEMORY
from auv_torchrl.physics import ActiveTerms, prepare
from auv_torchrl.physics.pushes import wrench_per_share, wrench_per_unit
from auv_torchrl.physics.thrusters import slowest_s, thrust_after, thrust_follower
from auv_torchrl.vehicle import load_vehicle
from benchmarks.underway.dives import FAULTS, ask, fly_dives

REMUS = load_vehicle("remus100")
C = prepare(REMUS)
TERMS = ActiveTerms.of(C)
DRAWN = 20  # dives, each with one fault of one fin


def test_a_sound_torpedo_has_no_gap():
    """Servos that take a quarter of a second and fins that push with the flow are what its file says."""
    diagnosis = diagnose(fly_dives(REMUS, {}, seed=1), REMUS)
    assert diagnosis.verdict is Verdict.NO_GAP and diagnosis.effects == ()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("values", "named"),
    [
        pytest.param({"fin_gain": {"gain_2": -1.0}}, {"gain_2": -1.0}, marks=pytest.mark.thorough),
        pytest.param(
            {"fin_gain": {"gain_2": -1.0, "gain_3": -1.0}},
            {"gain_2": -1.0, "gain_3": -1.0},
            marks=pytest.mark.thorough,
        ),
        pytest.param(
            {"fin_stuck": {"stuck_4": 1.0, "angle_4": 0.15}},
            {"gain_4": 0.0, "offset_4": 0.15},
            marks=pytest.mark.thorough,
        ),
    ],
    ids=["reversed", "both reversed", "stuck"],
)
def test_a_fault_of_a_fin_is_named(values, named):
    """Which fin, and how it turns: a stuck one does not follow, and stands where it stands."""
    diagnosis = diagnose(fly_dives(REMUS, values, seed=1), REMUS)
    assert diagnosis.verdict is Verdict.EXPLAINED
    found = {name: value for effect in diagnosis.effects for name, value in effect.parameters.items()}
    assert found.keys() == named.keys()
    for name, value in named.items():
        assert found[name].value == pytest.approx(value, abs=0.1 if name.startswith("gain") else 0.01)


@pytest.mark.thorough
def test_nine_of_ten_faults_of_fins_are_named():
    """The fin alone, and what it does: its gain where that is off, its middle where that is."""
    assert np.mean([ask(REMUS, FAULTS[seed % len(FAULTS)], seed).named for seed in range(DRAWN)]) >= 0.9


def test_a_log_remembers_as_many_commands_as_its_servos_need():
    """Twice the largest deflection over the rate; nothing where thrusters follow at once."""
    assert slowest_s(C, TERMS, LAG_MEMORY) == pytest.approx(2 * 0.237)
    plain = prepare(load_vehicle("paper"))
    assert slowest_s(plain, ActiveTerms.of(plain), LAG_MEMORY) == 0.0
    lagging = plain._replace(lag=plain.lag + 0.2)
    assert slowest_s(lagging, ActiveTerms.of(lagging), LAG_MEMORY) == pytest.approx(0.2 * LAG_MEMORY)
    begun, target = np.zeros(5), np.array([5.0, 0.2, -0.2, 0.02, 0.0])
    np.testing.assert_array_equal(
        thrust_follower(C, TERMS, 0.05)(begun, target), thrust_after(C, TERMS, begun, target, 0.05)
    )
    np.testing.assert_allclose(thrust_after(C, TERMS, begun, target, 0.05), [5.0, 0.05, -0.05, 0.02, 0.0])


def test_what_actuators_push_is_known_at_each_speed():
    """Of a hovering vehicle its allocation, to the bit; of fins with the square of the speed."""
    paper = prepare(load_vehicle("paper"))
    assert wrench_per_unit(paper, ActiveTerms.of(paper), 1.5) is paper.allocation
    np.testing.assert_array_equal(
        wrench_per_share(paper, ActiveTerms.of(paper), 1.5), paper.allocation * paper.full_thrust
    )
    speeds = np.array([[0.0, 1.0], [1.5, 2.0]])
    pushes = wrench_per_share(C.rows((None, None)), TERMS, speeds)
    assert pushes.shape == (2, 2, 6, 5)
    np.testing.assert_allclose(pushes[1, 1, :, 1:], 4 * pushes[0, 1, :, 1:], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(pushes[1, 0], wrench_per_share(C, TERMS, 1.5), rtol=1e-12)
