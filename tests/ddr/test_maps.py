"""G and H: recovered, in the right direction, alone and in batches."""

import pytest
import torch

from auv_torchrl.ddr.actuation import Channels, Thrusters
from auv_torchrl.ddr.affine import AffineMap
from auv_torchrl.ddr.bag import Pairs
from auv_torchrl.ddr.network import NetworkMap

ALL = torch.ones(1, dtype=torch.bool)
FAULTS = ("swap", "thruster_gain", "reversed", "reversed_and_dead", "cycle", "all_reversed")


def draw(*shape, seed=0):
    return 2 * torch.rand(*shape, generator=torch.Generator().manual_seed(seed)) - 1


def pairs_of(weight, bias: float | torch.Tensor = 0.0, count=40, noise=0.0, seed=0):
    control = draw(1, count, weight.shape[1], seed=seed)
    source = control @ weight.mT + bias + noise * draw(1, count, 4, seed=seed + 1)
    return Pairs(torch.zeros(1, count, 4), control, source, torch.ones(1, count, dtype=torch.bool))


@pytest.mark.parametrize("name", FAULTS)
def test_g_is_the_true_map_and_h_its_inverse(name, models, scenario, true_map):
    """From noisy pairs G is the analytic W and b within 0.03, and H undoes it: G(H(tau)) = tau."""
    per_thruster = true_map(scenario(name))
    for space, weight in (
        (Channels(models.actuation), per_thruster @ models.actuation.mixer),
        (Thrusters(models.actuation), per_thruster),
    ):
        bias = torch.tensor((0.05, -0.02, 0.1, 0.0))
        affine = AffineMap(1, space, ridge=1e-3)
        affine.fit(pairs_of(weight, bias, count=80, noise=0.02), ALL)
        torch.testing.assert_close(affine.weight[0], weight, atol=0.03, rtol=0)
        torch.testing.assert_close(affine.bias[0], bias, atol=0.02, rtol=0)
        tau = 0.1 * draw(20, 4, seed=5)
        control = affine.invert(torch.zeros(20, 4), tau)
        torch.testing.assert_close(affine(torch.zeros(1, 20, 4), control[None])[0], tau, atol=2e-3, rtol=0)


def test_a_three_cycle_shows_the_direction(models, scenario, true_map):
    """On 1 -> 2 -> 3 -> 1, H(G(tau_t)) is tau_t, while G used as H would apply the fault twice."""
    weight = true_map(scenario("cycle")) @ models.actuation.mixer
    affine = AffineMap(1, Channels(models.actuation), ridge=1e-3)
    affine.fit(pairs_of(weight), ALL)
    tau_t = 0.2 * draw(30, 4, seed=3)
    effect = affine(torch.zeros(1, 30, 4), tau_t[None])[0]
    torch.testing.assert_close(affine.invert(torch.zeros(30, 4), effect), tau_t, atol=2e-3, rtol=0)
    twice = affine(torch.zeros(1, 30, 4), effect[None])[0]
    assert (twice - tau_t).norm(dim=-1).mean() > 0.5 * tau_t.norm(dim=-1).mean()


def test_the_cycle_of_a_swap_hides_the_direction(models, scenario, true_map):
    """A swap is its own inverse: only because of that does the misprint of Eq. 11 go unnoticed in the paper."""
    weight = true_map(scenario("swap")) @ models.actuation.mixer
    torch.testing.assert_close(weight @ weight, torch.eye(4), atol=1e-5, rtol=0)


def test_gradient_steps_follow_a_small_drift(models):
    """Steps of Eq. 9 bring the map to a slightly changed vehicle without ever raising Eq. 8."""
    affine = AffineMap(1, Channels(models.actuation), ridge=1e-3)
    drifted = torch.diag(torch.tensor((0.9, 1.0, 1.1, 0.95)))
    pairs = pairs_of(drifted)
    errors = []
    for _ in range(300):
        errors.append((affine(pairs.state, pairs.control) - pairs.source).square().mean().item())
        affine.gradient_step(pairs, ALL, rate=0.5)
    assert all(later <= earlier + 1e-9 for earlier, later in zip(errors, errors[1:], strict=False))
    assert errors[-1] < 1e-3 * errors[0]
    torch.testing.assert_close(affine.weight[0], drifted, atol=0.01, rtol=0)


def test_a_batch_of_maps_is_fitted_as_each_alone(models):
    """Fitting and inverting m maps at once equals m single maps, and the mask leaves the others as they are."""
    space = Channels(models.actuation)
    weights = [torch.eye(4) + 0.3 * draw(4, 4, seed=i) for i in range(3)]
    single = [pairs_of(w, seed=i) for i, w in enumerate(weights)]
    together = AffineMap(3, space, ridge=1e-3)
    together.fit(Pairs(*(torch.cat(field) for field in zip(*single, strict=True))), torch.tensor([True, False, True]))
    tau = 0.2 * draw(3, 4, seed=9)
    for i in (0, 2):
        alone = AffineMap(1, space, ridge=1e-3)
        alone.fit(single[i], ALL)
        torch.testing.assert_close(together.weight[i], alone.weight[0])
        torch.testing.assert_close(together.invert(tau, tau)[i], alone.invert(tau[i : i + 1], tau[i : i + 1])[0])
    torch.testing.assert_close(together.weight[1], torch.eye(4))


def test_the_network_closes_a_gap_that_no_affine_map_closes(models):
    """With a curved, state-dependent effect the network's G errs less than half as much, and its H inverts it."""
    space = Channels(models.actuation)
    state, control = draw(1, 200, 4, seed=1), 0.4 * draw(1, 200, 4, seed=2)
    source = control + 0.5 * control * control.abs() + 0.1 * state
    pairs = Pairs(state, control, source, torch.ones(1, 200, dtype=torch.bool))
    affine, network = AffineMap(1, space, 1e-3), NetworkMap(space, 1e-3, 4, 16, 200, seed=0)
    errors = []
    for g in (affine, network):
        g.fit(pairs, ALL)
        g.refine(pairs, ALL)
        forward = (g(state, control) - source).square().mean().sqrt().item()
        back = (g.invert(state[0], source[0]) - control[0]).square().mean().sqrt().item()
        errors.append((forward, back))
    assert errors[1][0] < 0.5 * errors[0][0]
    assert errors[1][1] < 0.7 * errors[0][1]
