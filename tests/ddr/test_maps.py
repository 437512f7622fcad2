"""G and H: recovered, in the right direction."""

import pytest
import torch

from auv_torchrl.ddr.actuation import Channels, Thrusters
from auv_torchrl.ddr.affine import AffineMap
from auv_torchrl.ddr.bag import Pairs
from auv_torchrl.ddr.network import NetworkMap

FAULTS = ("swap", "thruster_gain", "reversed", "reversed_and_dead", "cycle", "all_reversed")


def draw(*shape, seed=0):
    return 2 * torch.rand(*shape, generator=torch.Generator().manual_seed(seed)) - 1


def pairs_of(weight, bias: float | torch.Tensor = 0.0, count=40, noise=0.0, seed=0):
    control = draw(count, weight.shape[1], seed=seed)
    source = control @ weight.mT + bias + noise * draw(count, 4, seed=seed + 1)
    return Pairs(torch.zeros(count, 4), control, source)


@pytest.mark.parametrize("name", FAULTS)
def test_g_is_the_true_map_and_h_its_inverse(name, models, scenario, true_map):
    """From noisy pairs G is the analytic W and b within 0.03, and H undoes it: G(H(tau)) = tau."""
    per_thruster = true_map(scenario(name))
    for space, weight in (
        (Channels(models.actuation), per_thruster @ models.actuation.mixer),
        (Thrusters(models.actuation), per_thruster),
    ):
        bias = torch.tensor((0.05, -0.02, 0.1, 0.0))
        affine = AffineMap(space, ridge=1e-3)
        affine.fit(pairs_of(weight, bias, count=80, noise=0.02))
        torch.testing.assert_close(affine.weight, weight, atol=0.03, rtol=0)
        torch.testing.assert_close(affine.bias, bias, atol=0.02, rtol=0)
        tau = 0.1 * draw(20, 4, seed=5)
        control = affine.invert(torch.zeros(20, 4), tau)
        torch.testing.assert_close(affine(torch.zeros(20, 4), control), tau, atol=2e-3, rtol=0)


def test_a_three_cycle_shows_the_direction(models, scenario, true_map):
    """On 1 -> 2 -> 3 -> 1, H(G(tau_t)) is tau_t, while G used as H would apply the fault twice."""
    weight = true_map(scenario("cycle")) @ models.actuation.mixer
    affine = AffineMap(Channels(models.actuation), ridge=1e-3)
    affine.fit(pairs_of(weight))
    tau_t = 0.2 * draw(30, 4, seed=3)
    effect = affine(torch.zeros(30, 4), tau_t)
    torch.testing.assert_close(affine.invert(torch.zeros(30, 4), effect), tau_t, atol=2e-3, rtol=0)
    twice = affine(torch.zeros(30, 4), effect)
    assert (twice - tau_t).norm(dim=-1).mean() > 0.5 * tau_t.norm(dim=-1).mean()


def test_the_cycle_of_a_swap_hides_the_direction(models, scenario, true_map):
    """A swap is its own inverse: only because of that does the misprint of Eq. 11 go unnoticed in the paper."""
    weight = true_map(scenario("swap")) @ models.actuation.mixer
    torch.testing.assert_close(weight @ weight, torch.eye(4), atol=1e-5, rtol=0)


def test_gradient_steps_follow_a_small_drift(models):
    """Steps of Eq. 9 bring the map to a slightly changed vehicle without ever raising Eq. 8."""
    affine = AffineMap(Channels(models.actuation), ridge=1e-3)
    drifted = torch.diag(torch.tensor((0.9, 1.0, 1.1, 0.95)))
    pairs = pairs_of(drifted)
    errors = []
    for _ in range(300):
        errors.append((affine(pairs.state, pairs.control) - pairs.source).square().mean().item())
        affine.gradient_step(pairs, rate=0.5)
    assert all(later <= earlier + 1e-9 for earlier, later in zip(errors, errors[1:], strict=False))
    assert errors[-1] < 1e-3 * errors[0]
    torch.testing.assert_close(affine.weight, drifted, atol=0.01, rtol=0)


def test_the_network_closes_a_gap_that_no_affine_map_closes(models):
    """With a curved, state-dependent effect the network's G errs less than half as much, and its H inverts it."""
    space = Channels(models.actuation)
    state, control = draw(200, 4, seed=1), 0.4 * draw(200, 4, seed=2)
    source = control + 0.5 * control * control.abs() + 0.1 * state
    pairs = Pairs(state, control, source)
    affine, network = AffineMap(space, 1e-3), NetworkMap(space, 1e-3, 4, 16, 200, seed=0)
    errors = []
    for g in (affine, network):
        g.fit(pairs)
        g.refine(pairs)
        forward = (g(state, control) - source).square().mean().sqrt().item()
        back = (g.invert(state, source) - control).square().mean().sqrt().item()
        errors.append((forward, back))
    assert errors[1][0] < 0.5 * errors[0][0]
    assert errors[1][1] < 0.7 * errors[0][1]
