"""Laws of mechanics that the model must obey for every vehicle, state and time."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from auv_torchrl.effects import EFFECTS, get_effect
from auv_torchrl.paths import config_names
from auv_torchrl.physics import ActiveTerms, State, control_step, prepare, rest_state
from auv_torchrl.physics.coefficients import total_mass_matrix
from auv_torchrl.physics.hydrodynamics import acceleration, coriolis_force
from auv_torchrl.physics.kinematics import (
    matvec,
    quaternion_from_euler,
    quaternion_product,
    rotation_and_rate,
    rotation_matrix,
    wrap_angle,
)
from auv_torchrl.physics.step import runge_kutta_step
from auv_torchrl.vehicle import load_vehicle
from auv_torchrl.vehicle.fields import GRAVITY
from auv_torchrl.vehicle.tensors import tensors

VEHICLES = config_names("vehicle")
seeds = st.integers(0, 2**31 - 1)
by_seed = settings(max_examples=4, deadline=None)


def random_state(vehicle, count, seed, speed=2.0, tilt=math.pi):
    generator = torch.Generator().manual_seed(seed)

    def uniform(*shape):
        return 2 * torch.rand(count, *shape, generator=generator, dtype=torch.float64) - 1

    quaternion = quaternion_from_euler(tilt * uniform(), tilt / 2 * uniform(), math.pi * uniform())
    state = rest_state(5 * uniform(3), quaternion, speed * uniform(6), vehicle.thrusters)
    return state, uniform(vehicle.thrusters)


def in_deep_water(name):
    """A vehicle of a name, with no surface above it: what its hull does there holds at one depth alone."""
    vehicle = tensors(load_vehicle(name))
    return vehicle.replace(air=torch.zeros_like(vehicle.air))


def on_numpy(state):
    """The same state for the same physics on numpy, which takes a third of the time on few vehicles."""
    return State(*(part.numpy() for part in state))


def energy(vehicle, state):
    """Kinetic energy with added mass, and potential energy of weight and buoyancy."""
    state = State(*(torch.as_tensor(part) for part in state))
    momentum = matvec(total_mass_matrix(vehicle), state.velocity)
    rotation = rotation_matrix(state.quaternion)
    low = state.position + matvec(rotation, vehicle.centre_of_mass.expand(3))
    up = state.position + matvec(rotation, vehicle.centre_of_buoyancy.expand(3))
    potential = -vehicle.mass * GRAVITY * low[..., 2] + vehicle.buoyancy * up[..., 2]
    return 0.5 * (state.velocity * momentum).sum(-1) + potential


@pytest.mark.parametrize("name", VEHICLES)
@pytest.mark.parametrize("strength", [0.0, 1.0])
@given(seed=seeds)
@by_seed
def test_energy_never_grows_without_thrust_and_current(name, strength, seed):
    """Drag only takes energy, and Coriolis terms give none, whatever the start."""
    vehicle = get_effect("coriolis").apply(in_deep_water(name), {"strength": strength})
    c = prepare(vehicle.expand(8)).numpy()
    terms = ActiveTerms.of(c)
    state = on_numpy(random_state(vehicle, 8, seed)[0])
    before = energy(vehicle, state)
    for _ in range(6):
        state = control_step(c, terms, state, np.zeros((8, vehicle.thrusters)), substeps=8)
        after = energy(vehicle, state)
        assert (after <= before + 1e-5 * before.abs().clamp_min(1)).all()
        before = after


@given(seed=seeds)
@by_seed
def test_mass_matrix_is_symmetric_positive_definite(seed):
    """M stays symmetric positive definite under every change that effects make to it."""
    generator = torch.Generator().manual_seed(seed)
    vehicle = tensors(load_vehicle("bluerov2")).expand(16)
    for name in ("added_mass", "payload", "mass_offset"):
        effect = get_effect(name)
        vehicle = effect.apply(
            vehicle,
            {
                member: p.low + (p.high - p.low) * torch.rand(16, generator=generator, dtype=torch.float64)
                for member, p in effect.member_parameters(vehicle).items()
            },
        )
    matrix = total_mass_matrix(vehicle)
    torch.testing.assert_close(matrix, matrix.mT)
    assert (torch.linalg.eigvalsh(matrix) > 0).all()


@given(seed=seeds)
@by_seed
def test_coriolis_forces_have_no_power(seed):
    """Nu . C(nu) nu = 0 for every symmetric mass matrix, so that C is skew-symmetric."""
    random = np.random.default_rng(seed)
    root = random.normal(size=(5, 6, 6))
    velocity = random.normal(size=(5, 6))
    force = coriolis_force(root @ root.mT, velocity)
    np.testing.assert_allclose(np.sum(velocity * force, axis=-1), 0.0, atol=1e-9)


@pytest.mark.parametrize("name", VEHICLES)
@given(seed=seeds, turn=st.floats(-3.0, 3.0), north=st.floats(-50, 50), east=st.floats(-50, 50))
@by_seed
def test_motion_does_not_depend_on_heading_or_place(name, seed, turn, north, east):
    """Turned about the vertical and moved, a flight is the same flight turned and moved."""
    vehicle = in_deep_water(name)
    c = prepare(vehicle.expand(4)).numpy()
    terms = ActiveTerms.of(c)
    state, command = random_state(vehicle, 4, seed, tilt=0.5)
    yaw = quaternion_from_euler(*torch.tensor([0.0, 0.0, turn], dtype=torch.float64))
    offset = torch.tensor([north, east, 3.0], dtype=torch.float64)
    rotation = rotation_matrix(yaw)
    moved = state._replace(
        position=matvec(rotation, state.position) + offset,
        quaternion=quaternion_product(yaw.expand(4, 4), state.quaternion),
    )
    state, moved = on_numpy(state), on_numpy(moved)
    for _ in range(5):
        state, moved = (control_step(c, terms, s, command.numpy()) for s in (state, moved))
    np.testing.assert_allclose(moved.velocity, state.velocity, rtol=0, atol=1e-9)
    expected = matvec(rotation.numpy(), state.position) + offset.numpy()
    np.testing.assert_allclose(moved.position, expected, rtol=0, atol=1e-9)


@given(seed=seeds, north=st.floats(-1, 1), east=st.floats(-1, 1), down=st.floats(-1, 1))
@by_seed
def test_a_uniform_current_is_a_moving_frame(seed, north, east, down):
    """With all Coriolis terms, a vehicle in moving water flies as in still water, seen from a drifting boat."""
    vehicle = get_effect("coriolis").apply(tensors(load_vehicle("bluerov2")), {"strength": 1.0})
    flow = torch.tensor([north, east, down], dtype=torch.float64)
    drifting = get_effect("current").apply(vehicle, {"north": north, "east": east, "down": down})
    still, command = random_state(vehicle, 1, seed, speed=1.0)
    body_flow = matvec(rotation_matrix(still.quaternion).mT, flow.expand(1, 3))
    moving = still._replace(velocity=still.velocity + torch.cat((body_flow, torch.zeros_like(body_flow)), -1))
    still, moving, command = on_numpy(still), on_numpy(moving), command.numpy()
    steps = 10
    boat, water = prepare(vehicle.expand(1)).numpy(), prepare(drifting.expand(1)).numpy()
    for _ in range(steps):
        still = control_step(boat, ActiveTerms.of(boat), still, command, substeps=12)
        moving = control_step(water, ActiveTerms.of(water), moving, command, substeps=12)
    expected = still.position + flow.numpy() * steps * 0.05
    np.testing.assert_allclose(moving.position, expected, rtol=0, atol=2e-6)


@pytest.mark.parametrize("name", VEHICLES)
def test_a_batch_flies_like_its_vehicles_alone(name):
    """Every effect drawn at random: a batch of vehicles gives what a loop over them gives."""
    vehicle = tensors(load_vehicle(name)).expand(5).clone()
    generator = torch.Generator().manual_seed(3)
    for effect in EFFECTS.values():
        first = vehicle[0]
        nominal, declared = effect.nominal(first), effect.member_parameters(first)
        share = 0.05 * torch.rand(5, generator=generator, dtype=torch.float64)
        values = {k: v + share * (declared[k].high - v) for k, v in nominal.items() if not declared[k].discrete}
        vehicle = effect.apply(vehicle, values)
    state, command = random_state(vehicle, 5, 7, speed=0.5, tilt=0.3)
    state = on_numpy(state._replace(commands=torch.zeros(5, 4, vehicle.thrusters, dtype=torch.float64)))

    def fly(rows):
        c = prepare(vehicle[rows]).numpy()
        now = State(*(part[rows] for part in state))
        for _ in range(10):
            now = control_step(c, ActiveTerms.of(c), now, command[rows].numpy())
        return now

    together = fly(slice(None))
    for row in range(5):
        for part, alone in zip(together, fly(slice(row, row + 1)), strict=True):
            np.testing.assert_allclose(part[row : row + 1], alone, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", VEHICLES)
def test_numpy_and_torch_run_the_same_lines(name):
    """The array library changes nothing beyond rounding."""
    vehicle = tensors(load_vehicle(name))
    c = prepare(vehicle.expand(6).clone())
    state, command = random_state(vehicle, 6, 1)
    arrays = on_numpy(state)
    for _ in range(20):
        state = control_step(c, ActiveTerms.of(c), state, command)
        arrays = control_step(c.numpy(), ActiveTerms.of(c.numpy()), arrays, command.numpy())
    for part, array in zip(state, arrays, strict=True):
        np.testing.assert_allclose(part.numpy(), array, rtol=0, atol=1e-10)


@pytest.mark.parametrize(
    "field", ["mass", "added_mass", "linear_drag", "quadratic_drag", "gain", "limit", "current", "centre_of_mass",
              "buoyancy", "payload_mass", "lag", "delay", "thruster_direction", "exponent"],
)  # fmt: skip
def test_gradients_by_parameters_are_right(field):
    """Analytic gradients of a flight by the vehicle's parameters agree with finite differences."""
    vehicle = tensors(load_vehicle("bluerov2")).expand(1).clone()
    vehicle = vehicle.replace(lag=vehicle.lag + 0.13, delay=vehicle.delay + 0.07)
    state, _ = random_state(vehicle, 1, 5, speed=0.3, tilt=0.2)
    state = state._replace(commands=torch.zeros(1, 4, 6, dtype=torch.float64))
    command = torch.tensor([[0.5, -0.6, 0.7, 0.4, -0.5, 0.6]], dtype=torch.float64)

    def fly(value):
        c, now = prepare(vehicle.replace(**{field: value})), state
        for _ in range(2):
            now = control_step(c, ActiveTerms.everything(), now, command, substeps=1)
        return torch.cat((now.position, now.velocity), -1)

    value = vehicle.get(field).detach().clone().requires_grad_()
    assert torch.autograd.gradcheck(fly, (value,), eps=1e-6, atol=1e-6)


@pytest.mark.parametrize("name", VEHICLES)
def test_gradients_are_finite_at_rest(name):
    """No square root, norm or power spoils the gradient of a vehicle that does not move."""
    vehicle = tensors(load_vehicle(name)).expand(2).map(lambda field: field.clone().requires_grad_())
    c = prepare(vehicle)
    zeros = torch.zeros(2, 6, dtype=torch.float64)
    upright = torch.tensor([[1.0, 0, 0, 0]] * 2, dtype=torch.float64)
    state = rest_state(zeros[:, :3], upright, zeros, vehicle.thrusters)
    command = torch.full((2, vehicle.thrusters), 0.3, dtype=torch.float64)
    after = control_step(c, ActiveTerms.everything(), state, command)
    (after.position.sum() + after.velocity.sum()).backward()
    for key, value in vehicle.items():
        assert value.grad is None or value.grad.isfinite().all(), key


def test_still_neutral_vehicle_stays():
    """A neutral vehicle at rest, upright, without commands, has no acceleration at all."""
    c = prepare(tensors(load_vehicle("paper")))
    zeros = torch.zeros(6, dtype=torch.float64)
    upright = torch.eye(3, dtype=torch.float64)
    assert (acceleration(c, ActiveTerms.of(c), upright, zeros[:3], zeros, zeros).abs() < 1e-12).all()


def test_full_surge_reaches_the_published_speed():
    """Table 1 with full thrust ends at 0.57 m/s in surge: 141 N = 36.8 v + 374.7 v^2."""
    c = prepare(tensors(load_vehicle("paper")).expand(1))
    zeros = torch.zeros(1, 6, dtype=torch.float64)
    state = rest_state(zeros[:, :3], torch.tensor([[1.0, 0, 0, 0]], dtype=torch.float64), zeros, 6)
    command = torch.tensor([[-1.0, -1, 1, 1, 0, 0]], dtype=torch.float64)
    for _ in range(100):
        state = control_step(c, ActiveTerms.of(c), state, command)
    thrust = 4 * 50 / math.sqrt(2)
    speed = (-36.8 + math.sqrt(36.8**2 + 4 * 374.7 * thrust)) / (2 * 374.7)
    torch.testing.assert_close(state.velocity[0, 0], torch.tensor(speed).double(), rtol=0, atol=1e-6)


@given(angle=st.floats(-100.0, 100.0))
def test_wrapped_angles_are_the_same_angle(angle):
    """wrap_angle gives the same direction in (-pi, pi]."""
    wrapped = float(wrap_angle(np.float64(angle)))
    assert -math.pi < wrapped <= math.pi
    assert math.isclose(math.cos(wrapped), math.cos(angle), abs_tol=1e-9)
    assert math.isclose(math.sin(wrapped), math.sin(angle), abs_tol=1e-9)


@given(seed=seeds, quarters=st.integers(1, 11))
@by_seed
def test_a_delayed_command_arrives_within_the_control_step(seed, quarters):
    """A delay of any number of quarter steps is exact: as if the fourfold finer step had sent each command later."""
    vehicle = get_effect("dead_band").apply(tensors(load_vehicle("paper")), {"width": 15.0}).expand(4).clone()
    vehicle = vehicle.replace(lag=vehicle.lag + 0.1)
    at_once = ActiveTerms.of(prepare(vehicle))
    coarse, _ = random_state(vehicle[0], 4, seed)
    fine = coarse
    coarse = coarse._replace(commands=torch.zeros(4, 5, vehicle.gain.shape[-1], dtype=torch.float64))
    late = vehicle.replace(delay=vehicle.delay + 0.0125 * quarters)
    rng = np.random.default_rng(seed)
    sent = torch.as_tensor(rng.uniform(-1, 1, (12, 4, vehicle.gain.shape[-1])))
    arriving = torch.cat((torch.zeros(quarters, *sent.shape[1:]), sent.repeat_interleave(4, dim=0)))
    later, sooner = prepare(late), prepare(vehicle)
    for command in sent:
        coarse = control_step(later, at_once, coarse, command, 0.05, 4)
    for command in arriving[:48]:
        fine = control_step(sooner, at_once, fine, command, 0.0125, 1)
    torch.testing.assert_close(coarse.position, fine.position, rtol=0, atol=1e-9)
    torch.testing.assert_close(coarse.velocity, fine.velocity, rtol=0, atol=1e-9)


@given(seed=seeds)
@by_seed
def test_a_force_from_outside_does_what_thrusters_that_make_it_do(seed):
    """The wrench of the thrusters, given as a force besides silent ones, moves the vehicle in the same way."""
    vehicle = tensors(load_vehicle("bluerov2_heavy"))
    c = prepare(vehicle.expand(4))
    state, _ = random_state(vehicle, 4, seed)
    body = torch.cat((state.position, state.quaternion, state.velocity), dim=-1)
    silent = torch.zeros(4, vehicle.thrusters, dtype=torch.float64)
    thrust = torch.as_tensor(np.random.default_rng(seed).uniform(-20, 20, silent.shape))
    terms = ActiveTerms.of(c)
    by_thrusters, _ = runge_kutta_step(c, terms, body, silent, thrust, state.time, 0.02)
    by_force, _ = runge_kutta_step(c, terms, body, silent, silent, state.time, 0.02, matvec(c.allocation, thrust))
    torch.testing.assert_close(by_force, by_thrusters, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("matrices", "vectors"),
    [
        ((), ()),
        ((), (5,)),
        ((1,), (4, 3)),
        ((3,), (4, 3)),
        ((3, 1), (4, 3, 5)),
        ((4, 3), (4, 3)),
        ((4, 3), (3,)),
        ((2, 1), (2, 1)),
    ],
)
@pytest.mark.parametrize("to", [np.asarray, torch.as_tensor])
def test_a_product_is_the_same_however_matrices_are_shared(matrices, vectors, to):
    """Matrices of one vehicle, of each vehicle, of each row or of each step multiply vectors as one by one."""
    rng = np.random.default_rng(0)
    matrix, vector = rng.standard_normal((*matrices, 2, 6)), rng.standard_normal((*vectors, 6))
    expected = np.einsum("...mn,...n->...m", matrix, vector)
    product = matvec(to(matrix), to(vector))
    assert product.shape == expected.shape
    np.testing.assert_allclose(np.asarray(product), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("array", [np.asarray, torch.as_tensor])
@given(seed=seeds, length=st.floats(0.2, 5.0))
@by_seed
def test_rotation_and_rate_are_those_of_the_unit_quaternion(array, seed, length):
    """A quaternion of any length turns as the unit one does, and its rate is half its product with the turn rate."""
    rng = np.random.default_rng(seed)
    unit = rng.standard_normal((3, 4))
    unit /= np.linalg.norm(unit, axis=-1, keepdims=True)
    omega, vector = rng.standard_normal((3, 3)), rng.standard_normal((3, 3))

    def pure(v):
        return np.concatenate([np.zeros((3, 1)), v], axis=-1)

    rotation, rate = (np.asarray(a) for a in rotation_and_rate(array(length * unit), array(omega)))
    turned = quaternion_product(quaternion_product(unit, pure(vector)), unit * [1, -1, -1, -1])
    np.testing.assert_allclose(matvec(rotation, vector), turned[:, 1:], atol=1e-12)
    np.testing.assert_allclose(rate, 0.5 * quaternion_product(unit, pure(omega)), atol=1e-12)
