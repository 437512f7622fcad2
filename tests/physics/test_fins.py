"""Lift and drag of fins: their law, and that every way to run the physics has it."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auv_torchrl.physics import ActiveTerms, prepare, rest_state
from auv_torchrl.physics.coefficients import total_mass_matrix
from auv_torchrl.physics.fins import ACROSS, fin_forces, fin_wrench
from auv_torchrl.physics.kinematics import matvec, quaternion_from_euler, rotation_matrix
from auv_torchrl.physics.pushes import wrench_per_share
from auv_torchrl.simulator import PlainSimulator
from auv_torchrl.simulator.mujoco import MujocoSimulator
from auv_torchrl.vehicle import load_vehicle
from auv_torchrl.vehicle.fields import WATER_DENSITY
from tests.physics.compiled import assert_same_accelerations, assert_same_gradients, assert_same_steps

REMUS = load_vehicle("remus100")
C = prepare(REMUS)
TERMS = ActiveTerms.of(C)
AREA = float(REMUS.fin_area[1])
numbers = st.floats(-2.0, 2.0)


def forces(linear, angular=(0.0, 0.0, 0.0), deflection=0.0, vehicle=REMUS):
    """Of each actuator, (5, 3) in N."""
    turned = np.broadcast_to(np.asarray(deflection, float), (5,))
    return fin_forces(prepare(vehicle), np.asarray(linear, float), np.asarray(angular, float), turned)


def flying(count, seed=0):
    """Random states and commands, at speeds and deflections on both sides of stall."""
    rng = np.random.default_rng(seed)
    angles = rng.uniform(-0.6, 0.6, (3, count))
    velocity = rng.uniform(-1.0, 1.0, (count, 6)) * [2.0, 1.0, 1.0, 0.5, 0.5, 0.5]
    state = rest_state(rng.normal(size=(count, 3)), quaternion_from_euler(*angles), velocity, 5)
    return state, rng.uniform(-1.0, 1.0, (count, 5))


def test_without_a_flow_there_is_no_force():
    """Whatever the deflection; and no vehicle without fins has the term."""
    assert (forces([0.0, 0.0, 0.0], deflection=0.2) == 0).all()
    assert TERMS.fins and not ActiveTerms.of(prepare(load_vehicle("bluerov2"))).fins


@pytest.mark.parametrize("angle", [-0.1, 0.02, 0.15])
def test_lift_and_drag_are_those_of_a_thin_fin_of_that_aspect_ratio(angle):
    """Half rho V^2 A times c_L sin a cos a, and c_D with the induced drag, by the formulas of books."""
    pressure = 0.5 * WATER_DENSITY * 1.5**2 * AREA
    upper = forces([1.5, 0.0, 0.0], deflection=angle)[1]
    lift = 1.45 * math.sin(angle) * math.cos(angle)
    assert upper[1] == pytest.approx(pressure * lift, rel=2e-3)
    assert upper[0] == pytest.approx(-pressure * (0.01 + lift**2 / (math.pi * 2.21)), rel=5e-3)
    assert upper[2] == 0


def test_a_pair_of_rudders_pushes_as_published():
    """Prestero's Y_uudr = 9.64 kg/m and N_uudr = -6.15 kg, per radian."""
    steered = wrench_per_share(C, TERMS, 1.5)[:, 1:3].sum(-1) / 0.237 / 1.5**2
    assert steered[1] == pytest.approx(9.64, rel=2e-3)
    assert steered[5] == pytest.approx(-6.15, rel=2e-3)
    assert (wrench_per_share(C, TERMS, 0.0)[:, 1:] == 0).all()
    assert wrench_per_share(C, TERMS, 1.5)[0, 0] == 10.9


def test_beyond_stall_a_fin_is_a_plate_across_the_flow():
    """Less lift than at the stall angle, and at a right angle the drag of a plate and no lift."""
    angles = np.linspace(0.0, math.pi / 2, 200)
    lifts = np.array([forces([1.0, 0.0, 0.0], deflection=angle)[1, 1] for angle in angles])
    best = angles[lifts.argmax()]
    assert 0.2 < best < 0.8 and lifts[-1] == pytest.approx(0.0, abs=1e-9)
    attached = 1.45 * np.sin(angles) * np.cos(angles) * 0.5 * WATER_DENSITY * AREA
    assert lifts[angles.searchsorted(0.45)] < 0.95 * attached[angles.searchsorted(0.45)]
    across = -forces([1.0, 0.0, 0.0], deflection=math.pi / 2)[1, 0] / (0.5 * WATER_DENSITY * AREA)
    assert across == pytest.approx(0.01 + ACROSS, rel=1e-3)


def test_the_flow_at_a_fin_is_that_of_the_turning_body():
    """A yaw rate alone makes rudders push against it, a sideways speed as the same inflow."""
    turning, drifting = forces([1.5, 0.0, 0.0], [0.0, 0.0, 0.1]), forces([1.5, -0.0638, 0.0])
    np.testing.assert_allclose(turning[1], drifting[1], rtol=1e-6)
    assert turning[1, 1] > 0 and (turning[1:, 1] * -0.638)[:2].sum() < 0


@given(st.tuples(numbers, numbers, numbers), st.tuples(numbers, numbers, numbers), st.floats(-3.0, 3.0))
@settings(max_examples=200, deadline=None)
def test_a_fin_that_is_held_takes_energy_and_gives_none(linear, angular, deflection):
    """The force times the velocity of the fin through the water is never above 0."""
    force = forces(linear, angular, deflection)
    velocity = np.asarray(linear) + np.cross(np.asarray(angular), REMUS.thruster_position)
    assert ((force * velocity).sum(-1) <= 1e-9).all()


def test_the_energy_of_a_gliding_vehicle_falls():
    """Neutral and without commands of the propeller, whatever the fins do."""
    neutral = REMUS.replace(buoyancy=REMUS.mass * 9.81, centre_of_mass=0 * REMUS.centre_of_mass)
    state, command = flying(20)
    command[:, 0] = 0.0
    simulator = PlainSimulator(neutral.expand(20), 0.05)
    simulator.resume(state)
    mass, energy = total_mass_matrix(neutral), []
    for _ in range(40):
        energy.append(0.5 * (simulator.state.velocity * matvec(mass, simulator.state.velocity)).sum(-1))
        simulator.step(command)
    assert (np.diff(energy, axis=0) < 1e-9).all()


def test_a_servo_turns_no_faster_than_its_rate():
    """1 rad/s: 0.05 rad after a step of 0.05 s, all of 0.237 after five; without a rate at once, as the propeller."""
    one = np.arange(1)
    rest = np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 6))
    simulator, moved = PlainSimulator(REMUS.expand(1), 0.05), []
    simulator.place(one, *rest)
    for _ in range(5):
        simulator.step(np.ones((1, 5)))
        moved.append(simulator.state.thrust[0, 1])
        assert simulator.state.thrust[0, 0] == 10.9
    np.testing.assert_allclose(moved, [0.05, 0.1, 0.15, 0.2, 0.237])
    quick = PlainSimulator(REMUS.replace(servo_rate=0 * REMUS.servo_rate).expand(1), 0.05)
    quick.place(one, *rest)
    quick.step(np.ones((1, 5)))
    assert quick.state.thrust[0, 1] == 0.237


def test_gain_and_offset_turn_a_fin():
    """The deflection is the gain times what is commanded, and the offset."""
    off = REMUS.replace(gain=-REMUS.gain, servo_offset=np.full(5, 0.05))
    np.testing.assert_allclose(
        forces([1.5, 0.2, 0], deflection=0.1, vehicle=off), forces([1.5, 0.2, 0], deflection=-0.05)
    )


def test_a_current_is_a_flow_too():
    """Still over ground in a current along the axis, a fin pushes as one that moves ahead in still water."""
    carried = prepare(REMUS.replace(current=np.array([-1.5, 0.0, 0.0])))
    thrust, still, level = np.full(5, 0.1), np.zeros(6), np.eye(3)
    moving = fin_wrench(C, TERMS, level, np.zeros(3), np.array([1.5, 0, 0, 0, 0, 0]), thrust)
    found = fin_wrench(carried, ActiveTerms.of(carried), level, np.zeros(3), still, thrust)
    np.testing.assert_allclose(found, moving, rtol=1e-12)


def test_compiled_steps_are_those_of_the_array_physics():
    """States and deflections after a step, on numpy and on torch."""
    assert_same_steps(REMUS, *flying(40))


def test_gradients_of_compiled_steps_are_those_of_torch():
    """By body, by thrust and by command."""
    assert_same_gradients(REMUS, *flying(6, seed=1))


def test_compiled_accelerations_are_those_of_the_array_physics(monkeypatch):
    """Along a motion that is known."""
    state, command = flying(7)
    assert_same_accelerations(REMUS, state, 0.2 * command, monkeypatch)


def test_mujoco_flies_the_same_fins():
    """After half a second within what its integrator differs by."""
    state, command = flying(4)
    flown = []
    for kind in (PlainSimulator, MujocoSimulator):
        simulator = kind(REMUS.expand(4), 0.05)
        simulator.place(np.arange(4), *state[:3])
        for _ in range(10):
            simulator.step(command)
        flown.append(simulator.state)
    np.testing.assert_allclose(flown[1].velocity, flown[0].velocity, atol=2e-3)
    np.testing.assert_allclose(flown[1].position, flown[0].position, atol=2e-3)
    assert rotation_matrix(flown[0].quaternion).shape == (4, 3, 3)
