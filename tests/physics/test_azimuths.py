"""Thrusters that a servo turns: where they push, and that every way to run the physics has it."""

import math

import numpy as np
import pytest

from auv_torchrl.physics import ActiveTerms, prepare, rest_state
from auv_torchrl.physics.azimuths import azimuth_wrench, servo_of
from auv_torchrl.physics.kinematics import quaternion_from_euler
from auv_torchrl.physics.pushes import steady_thrust, wrench_per_share, wrench_per_unit
from auv_torchrl.physics.thrusters import body_wrench
from auv_torchrl.simulator import PlainSimulator
from auv_torchrl.simulator.mujoco import MujocoSimulator
from auv_torchrl.vehicle import load_vehicle, read_vehicle_file
from tests.physics.compiled import assert_same_accelerations, assert_same_gradients, assert_same_steps

FERRY = load_vehicle("milliampere")
C = prepare(FERRY)
TERMS = ActiveTerms.of(C)


def pushed(thrust, vehicle=FERRY):
    """Wrench (6,) of thrusts and angles."""
    return body_wrench(prepare(vehicle), TERMS, np.asarray(thrust, float), np.zeros(()))


def steering(count, seed=0):
    """Random states about a cruise, and commands."""
    rng = np.random.default_rng(seed)
    velocity = rng.uniform(-0.3, 0.3, (count, 6)) + [1.5, 0, 0, 0, 0, 0]
    place, attitude = (
        rng.normal(size=(count, 3)) * [5, 5, 0.02],
        quaternion_from_euler(*rng.uniform(-0.1, 0.1, (3, count))),
    )
    return rest_state(place, attitude, velocity, 4), rng.uniform(-1.0, 1.0, (count, 4))


def tilting():
    """The ferry with a bow thruster that its servo tilts about y instead, and whose propeller turns the hull."""
    content = dict(read_vehicle_file("milliampere"))
    rows = [[1.0, 0.0, 0.5], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    return load_vehicle(
        content | {"thrusters": dict(content["thrusters"], direction=rows, reaction=[0.1, 0.0, 0.0, 0.0])}
    )


def test_a_turned_thruster_pushes_along_its_angle():
    """T (cos, sin) at the bow and at the stern, and the moments of both about the middle of the hull."""
    for bow, stern in ((0.0, 0.0), (0.3, -0.2), (math.pi / 2, math.pi)):
        found = pushed([200.0, 100.0, bow, stern])
        aside = 200 * math.sin(bow), 100 * math.sin(stern)
        ahead = 200 * math.cos(bow) + 100 * math.cos(stern)
        np.testing.assert_allclose(found, [ahead, sum(aside), 0, 0, 0, 1.8 * (aside[0] - aside[1])], atol=1e-9)


def test_about_any_axis_a_thruster_turns_as_a_rigid_body():
    """A slanted thruster, about y: what is along the axis stays, the rest turns, and the moment of its propeller."""
    vehicle, angle = tilting(), 0.4
    turn = np.array([[math.cos(angle), 0, math.sin(angle)], [0, 1, 0], [-math.sin(angle), 0, math.cos(angle)]])
    force = 200 * turn @ vehicle.thruster_direction[0]
    expected = [*force, *(np.cross([1.8, 0, 0], force) + 0.1 * force)]
    np.testing.assert_allclose(pushed([200.0, 0.0, angle, 0.7], vehicle), expected, atol=1e-9)


def test_a_vehicle_without_such_servos_has_no_such_term():
    """No flag of its terms, and an angle of none turns nothing to the bit."""
    for name in ("paper", "remus100", "otter"):
        c = prepare(load_vehicle(name))
        assert not ActiveTerms.of(c).azimuth and not servo_of(c).any()
    assert TERMS.azimuth and TERMS.servos and FERRY.azimuths == (2, 3) and FERRY.servos == (2, 3)
    assert (azimuth_wrench(C, np.array([300.0, -200.0, 0.0, 0.0])) == 0).all()


def test_gain_and_offset_turn_a_thruster():
    """The angle is the gain of the servo times what is commanded, and its offset; a thruster has a gain of its own."""
    off = FERRY.replace(gain=np.array([0.5, 1.0, -1.0, 0.0]), servo_offset=np.array([0.0, 0.0, 0.05, 0.3]))
    np.testing.assert_allclose(pushed([200.0, 100.0, 0.2, 0.6], off), pushed([100.0, 100.0, -0.15, 0.3]), atol=1e-9)


def test_a_servo_turns_no_faster_than_its_rate_and_in_air_as_well():
    """1 rad/s: 0.05 rad after a step of 0.05 s; thrusters, which have no rate, at once. In air they push nothing."""
    high = np.array([[0.0, 0.0, -3.0]])
    for place in (np.zeros((1, 3)), high):
        simulator = PlainSimulator(FERRY.expand(1), 0.05)
        simulator.place(np.arange(1), place, np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 6)))
        simulator.step(np.ones((1, 4)))
        np.testing.assert_allclose(simulator.state.thrust, [[500.0, 500.0, 0.05, 0.05]])
        assert bool(simulator.state.velocity[0, 0] > 0.01) is not place.any()


def test_what_servos_push_at_a_speed_is_the_slope_of_what_the_physics_does():
    """With the thrust that keeps up the speed, by differences of the wrench; nothing at rest."""
    found, steady = wrench_per_unit(C, TERMS, 1.5), steady_thrust(C, TERMS, np.array(1.5))
    assert steady[0] == steady[1] > 150 and (steady[2:] == 0).all()
    for servo in (2, 3):
        step = 1e-5 * np.eye(4)[servo]
        np.testing.assert_allclose(found[:, servo], (pushed(steady + step) - pushed(steady - step)) / 2e-5, atol=1e-4)
    assert (wrench_per_share(C, TERMS, 0.0)[:, 2:] == 0).all()
    assert wrench_per_share(C.rows((None, None)), TERMS, np.ones((2, 3))).shape == (2, 3, 6, 4)


def test_the_thrust_that_keeps_up_a_speed_keeps_it_up():
    """The ferry goes on at 1.5 m/s; with a dead thruster the other one gives all."""
    for gain in ((1.0, 1.0, 1.0, 1.0), (0.0, 1.0, 1.0, 1.0)):
        vehicle = FERRY.replace(gain=np.array(gain))
        c = prepare(vehicle)
        share = np.sqrt(steady_thrust(c, TERMS, np.array(1.5)) / c.full_thrust)  # a thrust by the square of the command
        simulator = PlainSimulator(vehicle.expand(1), 0.05)
        level = np.array([[1.0, 0.0, 0.0, 0.0]])
        simulator.place(np.arange(1), np.zeros((1, 3)), level, np.array([[1.5, 0.0, 0.0, 0.0, 0.0, 0.0]]))
        for _ in range(100):
            simulator.step(share[None])
        assert simulator.state.velocity[0, 0] == pytest.approx(1.5, abs=0.01)


def test_of_a_stuck_servo_its_thruster_pushes_where_it_stands():
    """Per share of the thruster: aside as well, and the servo pushes nothing."""
    stuck = prepare(FERRY.replace(gain=np.array([1.0, 1.0, 0.0, 1.0]), servo_offset=np.array([0.0, 0.0, 0.3, 0.0])))
    found = wrench_per_share(stuck, TERMS, 1.5)
    np.testing.assert_allclose(found[:2, 0], [500 * math.cos(0.3), 500 * math.sin(0.3)])
    assert (found[:, 2] == 0).all() and found[5, 3] < 0


@pytest.mark.parametrize("vehicle", [FERRY, tilting()], ids=["azimuth", "tilt"])
def test_compiled_steps_are_those_of_the_array_physics(vehicle):
    """States, thrusts and angles after a step, on numpy and on torch."""
    assert_same_steps(vehicle, *steering(40))


def test_gradients_of_compiled_steps_are_those_of_torch():
    """By velocity, by thrust and by command."""
    assert_same_gradients(FERRY, *steering(6, seed=1))


def test_compiled_accelerations_are_those_of_the_array_physics(monkeypatch):
    """Along a motion that is known."""
    state, command = steering(7)
    assert_same_accelerations(FERRY, state, command * FERRY.full_thrust, monkeypatch)


def test_mujoco_turns_the_same_thrusters():
    """After half a second within what its integrator differs by."""
    state, command = steering(4)
    flown = []
    for kind in (PlainSimulator, MujocoSimulator):
        simulator = kind(FERRY.expand(4), 0.05)
        simulator.place(np.arange(4), *state[:3])
        for _ in range(10):
            simulator.step(command)
        flown.append(simulator.state)
    np.testing.assert_allclose(flown[1].velocity, flown[0].velocity, atol=2e-3)
    np.testing.assert_allclose(flown[1].position, flown[0].position, atol=2e-3)
