"""Losses: TorchRL's, and for soft actor-critic one that computes the same with a third of the work."""

from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import NormalParamExtractor, dispatch
from torch import Tensor
from torchrl.modules import ProbabilisticActor, ValueOperator
from torchrl.objectives import ClipPPOLoss, SACLoss, TD3Loss, ValueEstimators
from torchrl.objectives.utils import distance_loss

from auv_torchrl.agents.networks import (
    Device,
    Layers,
    make_actor,
    make_critic,
    make_policy,
    make_value,
    perceptron,
    set_spread,
    tanh_normal,
)  # fmt: skip


class FusedSACLoss(SACLoss):
    """``SACLoss`` (second version, TD(0)) without its overhead; same parameters, losses, gradients.

    Critics run stacked in one batched product, the tanh-normal is written out, and no vmap, no functional call and
    no distribution object is made. Needs the networks of :mod:`auv_torchrl.agents.networks`.
    """

    has_closed_form = True  # of its gradients, in :mod:`auv_torchrl.agents.closed_form`
    log_alpha: Tensor
    target_entropy: Tensor  # pyright: ignore[reportIncompatibleMethodOverride]  # a property of SACLoss that gives one

    def __init_subclass__(cls, **options: Any):
        super().__init_subclass__(**options)
        cls.has_closed_form = False  # a loss of one's own has gradients of its own, by autograd

    def __init__(self, **settings: Any):
        super().__init__(**settings)
        self.extract = NormalParamExtractor()  # of mean and scale from what the actor's network gives
        self._known: dict[str, Layers] = {}

    def _apply(self, fn):
        self._known.clear()  # a move to another device or dtype makes new tensors
        return super()._apply(fn)

    def make_value_estimator(self, value_type: ValueEstimators | None = None, *, gamma: float, **unused):
        """TD(0) with discount ``gamma``."""
        super().make_value_estimator(ValueEstimators.TD0 if value_type is None else value_type, gamma=gamma, **unused)
        self.discount = gamma

    @dispatch()
    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Losses of a batch (B,) with observation, action and next observation, reward, terminated."""
        loss_qvalue = self._qvalue_loss(tensordict)
        loss_actor, log_prob = self._actor_loss(tensordict.get("observation"))
        loss_alpha = (-self.log_alpha * (log_prob + self.target_entropy)).mean()
        losses = {
            "loss_actor": loss_actor,
            "loss_qvalue": loss_qvalue,
            "loss_alpha": loss_alpha,
            "alpha": self.log_alpha.detach().exp(),
            "entropy": -log_prob.mean(),
        }
        return TensorDict(losses, [])

    def target(self, following: TensorDictBase, alpha: Tensor, action: Tensor, log_prob: Tensor) -> Tensor:
        """What the critics should say (B, 1), of what follows (B,), an action there and its log-probability."""
        pair = torch.cat((following.get("observation"), action), -1)
        value = perceptron(self.layers("target_qvalue_network_params"), pair).amin(0)
        reward = following.get("reward")
        soft = reward + self.discount * (value - alpha * log_prob.unsqueeze(-1))
        return torch.where(following.get("terminated"), reward, soft)

    def _qvalue_loss(self, batch: TensorDictBase) -> Tensor:
        following = batch.get("next")
        with torch.no_grad():
            target = self.target(following, self.log_alpha.exp(), *self.sample(following.get("observation")))
        pair = torch.cat((batch.get("observation"), batch.get("action")), -1)
        value = perceptron(self.layers("qvalue_network_params"), pair)
        return distance_loss(value, target.expand_as(value), self.loss_function).sum() / value.shape[1]

    def _actor_loss(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        action, log_prob = self.sample(observation)
        critics = [(weight.detach(), bias.detach()) for weight, bias in self.layers("qvalue_network_params")]
        value = perceptron(critics, torch.cat((observation, action), -1))
        loss = (self.log_alpha.detach().exp() * log_prob - value.amin(0).squeeze(-1)).mean()
        return loss, log_prob.detach()

    def sample(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Actions (B, a) of the actor in observations (B, d), with gradients, and their log-probabilities (B,)."""
        loc, scale = self.extract(perceptron(self.layers("actor_network_params"), observation))
        return tanh_normal(loc, scale, torch.randn_like(loc))[1:]

    def layers(self, network: str) -> Layers:
        """Weights and biases of ``network`` in order; looked up once, because they are only changed in place."""
        if network not in self._known:
            leaves = getattr(self, network).flatten_keys(".")
            names = [key.removesuffix("weight") for key in list(leaves.keys()) if key.endswith("weight")]
            self._known[network] = [(leaves[f"{name}weight"], leaves[f"{name}bias"]) for name in names]
        return self._known[network]


LOSSES = {"fused": FusedSACLoss, "stock": SACLoss}


def make_loss(
    name: str | type[SACLoss],
    observations: int,
    actions: int,
    hidden: tuple[int, ...],
    gamma: float,
    target_entropy: float,
    alpha_init: float,
    distance: str = "l1",
    device: Device = "cpu",
) -> SACLoss:
    """Actor, twin critics and their targets in one loss module: ``"fused"``, ``"stock"``, or a class of one's own.

    ``distance`` of the critics from what they should say is ``"l1"``, ``"l2"`` or ``"smooth_l1"``.
    """
    loss = (LOSSES[name] if isinstance(name, str) else name)(
        actor_network=make_actor(observations, actions, hidden, device),
        qvalue_network=make_critic(observations, actions, hidden, device),
        num_qvalue_nets=2,
        loss_function=distance,
        alpha_init=alpha_init,
        target_entropy=target_entropy,
        delay_qvalue=True,
    )
    loss.make_value_estimator(ValueEstimators.TD0, gamma=gamma)
    return loss


def make_td3_loss(
    observations: int,
    actions: int,
    hidden: tuple[int, ...],
    gamma: float,
    exploration: float,
    target_noise: float,
    target_noise_limit: float,
    device: Device = "cpu",
) -> TD3Loss:
    """Actor, twin critics and the targets of all in TorchRL's loss module.

    The actor has the spread ``exploration`` before its tanh where it explores, which nothing changes.
    """
    actor = make_policy(observations, actions, hidden, device)
    set_spread(actor, exploration)
    loss = TD3Loss(
        actor_network=actor,
        qvalue_network=make_critic(observations, actions, hidden, device),
        bounds=(-1.0, 1.0),  # pyright: ignore[reportArgumentType]  # its type says one number
        policy_noise=target_noise,
        noise_clip=target_noise_limit,
        loss_function="l2",
    )
    loss.make_value_estimator(ValueEstimators.TD0, gamma=gamma)
    return loss


def make_ppo_loss(
    observations: int, actions: int, hidden: tuple[int, ...], clip: float, entropy: float, device: Device = "cpu"
) -> tuple[ProbabilisticActor, ValueOperator, ClipPPOLoss]:
    """Actor, value of an observation, and both in TorchRL's loss module, which shares their weights."""
    actor, value = make_actor(observations, actions, hidden, device), make_value(observations, hidden, device)
    loss = ClipPPOLoss(
        actor_network=actor,
        critic_network=value,
        clip_epsilon=clip,
        entropy_coeff=entropy,
        loss_critic_type="l2",
        normalize_advantage=True,
    )
    return actor, value, loss
