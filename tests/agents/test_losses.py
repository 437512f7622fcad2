"""The fused loss is the stock loss, only faster."""

from typing import Any, cast

import pytest
import torch
from tensordict import TensorDict
from torchrl.envs.utils import ExplorationType, set_exploration_type
from torchrl.objectives import SACLoss, SoftUpdate

from auv_torchrl.agents.learning.fused import ClosedForm, FusedSACLoss, leaves
from auv_torchrl.agents.learning.losses import make_loss
from auv_torchrl.agents.learning.updater import SACUpdater
from auv_torchrl.agents.networks import make_actor, make_policy, tanh_normal

pytestmark = pytest.mark.filterwarnings("ignore:No target network updater")  # losses on their own, in these tests
SETTINGS = {"observations": 7, "actions": 3, "gamma": 0.97, "target_entropy": -3.0, "alpha_init": 0.2}


def batch_of(rows: int, spread: float = 1.0) -> TensorDict:
    flags = {key: torch.rand(rows, 1) < 0.2 for key in ("done", "terminated")}
    following = {"observation": spread * torch.randn(rows, 7), "reward": torch.randn(rows, 1), **flags}
    current = {"observation": spread * torch.randn(rows, 7), "action": 2 * torch.rand(rows, 3) - 1}
    return TensorDict({**current, "next": following}, batch_size=[rows])


def both(hidden: tuple[int, ...] = (16, 16), distance: str = "l1"):
    stock = make_loss("stock", hidden=hidden, distance=distance, **SETTINGS)
    fused = make_loss("fused", hidden=hidden, distance=distance, **SETTINGS)
    for network in ("qvalue_network_params", "target_qvalue_network_params", "actor_network_params"):
        for parameter in leaves(stock, network):
            parameter.data.normal_(std=0.3)  # targets that differ from the online critics
    fused.load_state_dict(stock.state_dict())
    return stock, fused


@pytest.mark.parametrize("spread", [1.0, 30.0], ids=["ordinary", "saturated"])
@pytest.mark.parametrize("hidden", [(16,), (16, 16), (8, 12, 10)], ids=str)
@pytest.mark.parametrize("distance", ["l1", "l2", "smooth_l1"])
def test_fused_loss_equals_stock_loss(distance, hidden, spread):
    """With the same parameters and random numbers, all losses and all gradients agree."""
    torch.manual_seed(0)
    stock, fused = both(hidden, distance)
    batch = batch_of(40, spread)
    results = []
    for loss in (stock, fused):
        torch.manual_seed(1)
        out = loss(batch.clone())
        (out["loss_actor"] + out["loss_qvalue"] + out["loss_alpha"]).backward()
        results.append(({key: out[key] for key in fused.out_keys}, {n: p.grad for n, p in loss.named_parameters()}))
    (stock_losses, stock_gradients), (losses, gradients) = results
    torch.testing.assert_close(losses, stock_losses, rtol=1e-5, atol=1e-5)
    assert gradients.keys() == stock_gradients.keys()
    for name, gradient in stock_gradients.items():
        assert gradient.abs().max() > 0, name
        torch.testing.assert_close(gradients[name], gradient, rtol=1e-4, atol=1e-5, msg=name)


@pytest.mark.parametrize("actor", [True, False], ids=["all", "critics alone"])
@pytest.mark.parametrize("spread", [1.0, 30.0], ids=["ordinary", "saturated"])
@pytest.mark.parametrize("hidden", [(16,), (16, 16), (8, 12, 10)], ids=str)
@pytest.mark.parametrize("distance", ["l1", "l2", "smooth_l1"])
def test_the_closed_form_is_what_autograd_finds(distance, hidden, spread, actor):
    """With the same parameters and random numbers, all losses and all gradients agree, and none is left behind."""
    torch.manual_seed(0)
    _, fused = both(hidden, distance)
    batch = batch_of(40, spread)
    torch.manual_seed(1)
    expected = fused(batch)
    total = expected["loss_qvalue"]
    (total + expected["loss_actor"] + expected["loss_alpha"] if actor else total).backward()
    gradients = {name: parameter.grad for name, parameter in fused.named_parameters()}
    torch.manual_seed(1)
    losses = ClosedForm(cast(FusedSACLoss, fused))(batch, actor)
    torch.testing.assert_close(losses.detach(), expected.detach(), rtol=1e-5, atol=1e-5)
    for name, parameter in fused.named_parameters():
        torch.testing.assert_close(parameter.grad, gradients[name], rtol=1e-4, atol=1e-5, msg=name)


def test_a_loss_of_ones_own_is_differentiated():
    """A class that inherits from the fused loss is asked for its losses, and autograd for their gradients."""

    class Halved(FusedSACLoss):
        def forward(self, batch):  # pyright: ignore[reportIncompatibleMethodOverride]
            return super().forward(batch) * 0.5

    torch.manual_seed(0)
    loss = make_loss(Halved, hidden=(16,), **SETTINGS)
    batch = batch_of(40)
    torch.manual_seed(1)
    expected = loss(batch)
    torch.manual_seed(1)
    torch.testing.assert_close(SACUpdater(loss, 0.0, 0.0, 0.5).step(batch).detach(), expected.detach())


def test_the_stock_loss_is_stepped_by_parts_of_torchrl_alone():
    """``agent.loss=stock`` is ``SACLoss`` and ``SoftUpdate``, and nothing that is written out."""
    updater = SACUpdater(make_loss("stock", hidden=(16,), **SETTINGS), 1e-3, 1e-3, 0.05)
    assert (type(updater.loss), type(updater.target_update)) == (SACLoss, SoftUpdate)


def test_actor_loss_gives_critics_no_gradient():
    """The actor's loss moves the actor alone, and the critics' loss the critics alone."""
    _, fused = both()
    out = fused(batch_of(40))
    critics, actor = leaves(fused, "qvalue_network_params"), leaves(fused, "actor_network_params")
    for loss, idle in (("loss_actor", critics), ("loss_qvalue", actor), ("loss_alpha", critics + actor)):
        gradients = torch.autograd.grad(out[loss], idle, retain_graph=True, allow_unused=True)
        assert all(gradient is None for gradient in gradients), loss


def test_updates_stay_together():
    """Ten updates with the stock and the fused loss end at the same parameters and targets."""
    torch.manual_seed(0)
    batches = [batch_of(64) for _ in range(10)]
    stock, fused = both()
    for loss in (stock, fused):
        updater = SACUpdater(loss, learning_rate=1e-3, alpha_learning_rate=1e-3, tau=0.05)
        torch.manual_seed(1)
        for batch in batches:
            updater.step(batch.clone())
    for (name, expected), value in zip(stock.state_dict().items(), fused.state_dict().values(), strict=True):
        torch.testing.assert_close(value, expected, rtol=1e-3, atol=1e-4, msg=name)


def test_written_out_tanh_normal_is_tanh_normal():
    """Samples and log-probabilities are those of TorchRL's distribution, far into saturation."""
    actor = make_actor(7, 3, [16])
    observed = TensorDict({"observation": 40 * torch.randn(500, 7)}, batch_size=[500])
    dist = cast(Any, actor.get_dist(observed))  # TorchRL says that it is any distribution
    torch.manual_seed(2)
    expected, expected_log_prob = dist.rsample_and_log_prob()
    torch.manual_seed(2)
    _, action, log_prob = tanh_normal(dist.loc, dist.scale, torch.randn_like(dist.loc))
    torch.testing.assert_close(action, expected)
    torch.testing.assert_close(log_prob, expected_log_prob, rtol=1e-4, atol=1e-3)


def test_policy_is_the_actor():
    """The hand-written policy acts as the probabilistic actor, with and without exploration."""
    actor, policy = make_actor(7, 3, [16]), make_policy(7, 3, [16])
    weights = zip(policy.parameters(), actor.parameters(), strict=True)
    for own, other in weights:
        own.data = other.data
    observation = TensorDict({"observation": torch.randn(50, 7)}, batch_size=[50])
    for exploration in (ExplorationType.DETERMINISTIC, ExplorationType.RANDOM):
        with set_exploration_type(exploration), torch.no_grad():
            torch.manual_seed(3)
            expected = actor(observation.clone())["action"]
            torch.manual_seed(3)
            action = policy(observation.clone())["action"]
        torch.testing.assert_close(action, expected, rtol=1e-5, atol=1e-5)
