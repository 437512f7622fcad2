"""The source motion against the physics it stands for."""

import numpy as np
import pytest
import torch

from auv_torchrl.adaptation.motion import SourceMotion
from auv_torchrl.physics import ActiveTerms, control_step, prepare, rest_state
from auv_torchrl.vehicle import CONTROLLED_INDEX, load_vehicle
from auv_torchrl.vehicle.tensors import tensors
from tests.hovering import HOVERING


@pytest.mark.parametrize("name", HOVERING)
def test_one_step_is_that_of_the_plain_physics(name):
    """Velocity after a control step agrees with the plain model's, but for what roll and pitch do."""
    motion, vehicle = SourceMotion(load_vehicle(name), 0.05), tensors(load_vehicle(name))
    rng = np.random.default_rng(0)
    velocity, command = rng.uniform(-0.4, 0.4, (20, 4)), rng.uniform(-0.8, 0.8, (20, vehicle.thrusters))
    c = prepare(vehicle.expand(20).clone())
    full = torch.zeros(20, 6, dtype=torch.float64)
    full[:, list(CONTROLLED_INDEX)] = torch.from_numpy(velocity)
    level = torch.tensor([[1.0, 0, 0, 0]], dtype=torch.float64).expand(20, 4)
    state = rest_state(torch.zeros(20, 3, dtype=torch.float64), level, full, vehicle.thrusters)
    after = control_step(c, ActiveTerms.of(c), state, torch.from_numpy(command))
    share = (after.thrust / c.full_thrust).numpy()
    step = motion(velocity, share @ motion.per_share.T)
    expected = after.velocity[:, list(CONTROLLED_INDEX)].numpy()
    np.testing.assert_allclose(step.velocity[:, :3], expected[:, :3], atol=1e-3 if name == "paper" else 0.03)


def test_a_fast_vehicle_is_integrated_as_finely_as_in_the_plain_physics():
    """At up to 2 m/s, where coarse steps would be wrong by centimetres per second, the step stays exact."""
    motion, vehicle = SourceMotion(load_vehicle("paper"), 0.05), tensors(load_vehicle("paper"))
    c = prepare(vehicle.expand(4).clone())
    full = torch.tensor([[2.0, 0, 0, 0, 0, 0], [0, 2.0, 0, 0, 0, 0], [0, 0, 2.0, 0, 0, 0], [1.2, 1.2, -1.2, 0, 0, 1]])
    level = torch.tensor([[1.0, 0, 0, 0]], dtype=torch.float64).expand(4, 4)
    state = rest_state(torch.zeros(4, 3, dtype=torch.float64), level, full.double(), vehicle.thrusters)
    after = control_step(c, ActiveTerms.of(c), state, torch.zeros(4, vehicle.thrusters, dtype=torch.float64))
    _, reached = motion.advance(full[:, list(CONTROLLED_INDEX)].double().numpy(), np.zeros((4, 4)))
    np.testing.assert_allclose(reached, after.velocity[:, list(CONTROLLED_INDEX)].numpy(), atol=1e-9)


def test_derivatives_are_those_of_the_step():
    """The derivatives by velocity and wrench predict the effect of small changes."""
    motion = SourceMotion(load_vehicle("paper"), 0.05)
    rng = np.random.default_rng(1)
    v, w = rng.uniform(-0.5, 0.5, (5, 4)), rng.uniform(-1, 1, (5, 4)) * motion.full_wrench
    dv, dw = 1e-3 * rng.standard_normal((5, 4)), 1e-3 * rng.standard_normal((5, 4)) * motion.full_wrench
    before, after = motion(v, w), motion(v + dv, w + dw)
    expected = (before.by_velocity @ dv[..., None] + before.by_wrench @ dw[..., None])[..., 0]
    actual = np.concatenate((after.displacement - before.displacement, after.velocity - before.velocity), axis=-1)
    np.testing.assert_allclose(actual, expected, atol=3e-4 * np.abs(expected).max() + 1e-5)
