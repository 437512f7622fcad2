"""A vehicle at the surface of the water: how deep it floats, what its thrusters lift, and that all simulators agree."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from auv_torchrl.effects import EFFECTS
from auv_torchrl.physics import ActiveTerms, prepare
from auv_torchrl.physics.kernel import Advance, Steps
from auv_torchrl.physics.step import runge_kutta_steps
from auv_torchrl.physics.surface import FULL_BELOW, NONE_ABOVE, PROPELLER_RADIUS, immersed
from auv_torchrl.simulator import PlainSimulator, at_rest
from auv_torchrl.simulator.mujoco import MujocoSimulator
from auv_torchrl.vehicle import load_vehicle, read_vehicle_file, stacked
from auv_torchrl.vehicle.changed_file import entries, fold
from auv_torchrl.vehicle.fields import GRAVITY
from auv_torchrl.vehicle.tensors import tensors
from tests.physics.test_adjoint import flight, outcome
from tests.physics.test_kernel import H, assert_equal, drawn_flight, names, seeds, written
from tests.uneven import load_any

SURFACE = EFFECTS["free_surface"]
LEVEL = -0.5  # m, z of the surface
DAMPED = {"linear_drag": [40.0, 40.0, 40.0, 4.0, 4.0, 4.0]}  # kg/s, kg m^2/s: it soon rests


def light_vehicle(share, **entry):
    """A BlueROV2 that weighs ``share`` of what it displaces, at a surface, and floats upright."""
    content = dict(read_vehicle_file("bluerov2"))
    body = dict(content["rigid_body"])
    body |= {"buoyancy": body["mass"] * GRAVITY / share, "hull_height": 0.25, "centre_of_buoyancy": [0.0, 0.0, -0.05]}
    return load_vehicle(content | {"rigid_body": body | entry, "surface": LEVEL, "air": 1.0} | DAMPED)


def settled(kind, *vehicles, command=0.0, seconds=40.0, z=0.5):
    """Where each comes to rest from ``z`` under a command of all vertical thrusters, m below the surface."""
    count, (one, *_) = len(vehicles), vehicles
    simulator = kind(stacked(vehicles), 0.05)
    simulator.state = at_rest(np.tile([0.0, 0.0, z], (count, 1)), np.zeros(count), one.thrusters)
    commands = np.where(np.abs(one.thruster_direction[:, 2]) > 0.9, command, 0.0)
    for _ in range(round(seconds / 0.05)):
        assert not simulator.step(np.tile(commands, (count, 1))).any()
    assert np.abs(simulator.state.velocity).max() < 1e-3
    return simulator.state.position[:, 2] - LEVEL


@pytest.mark.parametrize("kind", [PlainSimulator, MujocoSimulator])
def test_a_light_vehicle_floats_where_its_weight_is_its_buoyancy(kind):
    """Archimedes: as much of it is in the water as it weighs of what it displaces; the same in both simulators."""
    shares = [0.9, 0.5, 0.25]
    draught = settled(kind, *map(light_vehicle, shares)) - 0.05  # of the centre of each hull, m
    assert immersed(draught, 0.125, 0.125) == pytest.approx(np.array(shares), abs=2e-3)


def test_thrust_down_pulls_it_under_by_what_it_is_lighter():
    """Its thrusters hold it deeper by as much buoyancy as they give thrust; below all of it, it sinks on."""
    vehicle = light_vehicle(0.8)
    net = float(vehicle.buoyancy - vehicle.mass * GRAVITY)
    vertical = int((np.abs(vehicle.thruster_direction[:, 2]) > 0.9).sum())
    full = float(vehicle.full_thrust[0])
    sense = float(vehicle.thruster_direction[np.abs(vehicle.thruster_direction[:, 2]) > 0.9][0, 2])
    half = (net / 2 / vertical / full) ** (1 / float(vehicle.exponent[0]))
    (draught,) = settled(PlainSimulator, vehicle, command=sense * half) - 0.05
    reach = float(immersed(np.array(draught), 0.125, 0.125))
    assert reach * float(vehicle.buoyancy) == pytest.approx(float(vehicle.mass) * GRAVITY + net / 2, rel=0.01)


def test_thrust_up_lifts_it_no_farther_than_its_propellers_reach():
    """However hard they push, thrusters that leave the water give nothing: it hangs with them at the surface."""
    vehicle = light_vehicle(0.98)
    vertical = np.abs(vehicle.thruster_direction[:, 2]) > 0.9
    sense = float(vehicle.thruster_direction[vertical][0, 2])
    (centre,) = settled(PlainSimulator, vehicle, command=-sense, seconds=120.0)
    axis = centre + float(vehicle.thruster_position[vertical][0, 2])
    assert -NONE_ABOVE < axis < FULL_BELOW


def test_the_loss_of_a_propeller_is_near_that_of_its_source():
    """Minsaas et al. 1983, from 0.48 radii above the surface to 1.3 below it, within 0.06."""
    radii = np.linspace(-0.48, 1.3, 50)
    source = 1 - 0.675 * (1 - 0.769 * radii) ** 1.258
    ours = immersed(radii * PROPELLER_RADIUS, NONE_ABOVE, FULL_BELOW)
    assert np.abs(ours - source).max() < 0.06


@given(name=names, seed=seeds)
@settings(max_examples=10)
def test_water_everywhere_is_no_surface(name, seed):
    """Where nothing is missing above the surface, the term does nothing, to the last bit."""
    rng = np.random.default_rng(seed)
    deep = tensors(load_any(name)).expand(3).clone()
    there = SURFACE.apply(deep, {"depth": torch.as_tensor(rng.normal(size=3)), "air": 0.0})
    body, thrust, targets, time = flight(prepare(deep), rng)
    every = ActiveTerms.everything()
    plain = every._replace(surface=False)
    expected = runge_kutta_steps(prepare(deep), plain, body, thrust, targets, time, H)
    found = runge_kutta_steps(prepare(there), every, body, thrust, targets, time, H)
    assert all(torch.equal(ours, theirs) for ours, theirs in zip(found, expected, strict=True))


def at_the_surface(name, rows, rng):
    """Vehicles (rows,) about whose origin the surface lies, with some air above."""
    depth, air = 0.3 * rng.normal(size=rows), rng.random(rows)
    return SURFACE.apply(load_any(name).expand(rows), {"depth": depth, "air": air}).clone()


@given(name=names, seed=seeds, windows=st.integers(1, 5), rows=st.integers(2, 9))
@settings(max_examples=12)
def test_compiled_steps_are_the_written_ones(name, seed, windows, rows):
    """For vehicles that are half in the water, too, in and out of it on their way."""
    rng = np.random.default_rng(seed)
    c = prepare(at_the_surface(name, rows, rng)).numpy()
    steps = Steps(c, ActiveTerms.of(c), H)
    assert steps.compiled
    motion = drawn_flight(windows, rows, 3, c.full_thrust.shape[-1], rng)
    assert_equal(steps.run(*motion), written(c, ActiveTerms.of(c), *motion))


@given(name=names, seed=seeds, rows=st.integers(2, 9))
@settings(max_examples=12)
def test_the_compiled_gradient_is_that_of_torch(name, seed, rows):
    """A policy may be trained at the surface."""
    rng = np.random.default_rng(seed)
    c = prepare(tensors(at_the_surface(name, rows, rng)))
    given_state = flight(c, rng)
    weights = [torch.as_tensor(rng.normal(size=part.shape)) for part in given_state[:2]]
    found, slopes = outcome(Advance(), c, ActiveTerms.of(c), *given_state, weights)
    expected, true_slopes = outcome(runge_kutta_steps, c, ActiveTerms.of(c), *given_state, weights)
    for ours, theirs in zip((*found, *slopes), (*expected, *true_slopes), strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-6, atol=1e-6 * max(1.0, float(theirs.detach().abs().max())))


def test_a_file_may_say_where_the_surface_is():
    """Read, written and read again; what is no share of water is refused, and a hull of no height is a cube."""
    vehicle = light_vehicle(0.9)
    again = load_vehicle(entries(fold(vehicle), "light"))
    assert (float(again.surface), float(again.air), float(again.hull_height)) == (LEVEL, 1.0, 0.25)
    cube = prepare(load_vehicle("bluerov2_heavy")).hull_height
    assert float(cube) == pytest.approx(0.0134 ** (1 / 3), rel=1e-3)  # its volume in m^3 is published
    with pytest.raises(ValueError, match=r"air is 2.0: give values in \[0, 1\]"):
        load_vehicle(dict(read_vehicle_file("paper")) | {"air": 2.0})
    with pytest.raises(ValueError, match="hull_height is -1.0: give values of 0 or more"):
        light_vehicle(0.9, hull_height=-1.0)
