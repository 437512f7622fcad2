"""Soft actor-critic with its gradients written out: those that autograd finds for TorchRL's ``SACLoss``, in less time.

``agent.loss=fused``; ``agent.loss=stock`` takes TorchRL's ``SACLoss`` and ``SoftUpdate``, and autograd. The losses are
the second version of Haarnoja et al. (2018), of B transitions (x, a, r, x'), twin critics Q_k with targets Q'_k, an
actor pi and a temperature alpha = exp(log_alpha); d is the distance, ``critic_distance``::

    y       = r + gamma (1 - terminated) (min_k Q'_k(x', a') - alpha log pi(a'|x'))      a' drawn from pi(x')
    L_Q     = 1/B sum_b sum_k d(Q_k(x, a) - y)
    L_pi    = 1/B sum_b (alpha log pi(c|x) - min_k Q_k(x, c))                            c drawn from pi(x)
    L_alpha = -log_alpha (1/B sum_b log pi(c|x) + target_entropy)

Critics. L_Q and L_pi go back through them together: dL_Q/dQ_k(x, a) = d'(Q_k - y) / B moves their weights, and
dL_pi/dQ_k(x, c) = -1/B for the k that is least leads on to c alone. Call g what arrives there.

Actor. c = tanh u with u = mu + sigma e and noise e, and log pi(c|x) sums, over the actions,
log N(u; mu, sigma) - log(1 - tanh^2 u). For given e the first part depends on sigma alone, by -log sigma; the slope of
the second part by u is 2 tanh u. So::

    dL_pi/du     = g (1 - tanh^2 u) + alpha/B 2 tanh u = dL_pi/dmu
    dL_pi/dsigma = dL_pi/du e - alpha/B 1/sigma

and sigma = softplus(s + bias) + a constant has the slope sigmoid(s + bias). Where TorchRL cuts an action off just below
1, g does not pass. Temperature: dL_alpha/dlog_alpha = entropy - target_entropy.

Observations now and afterwards go through the actor at once, as do stored and drawn actions through the critics.
Weights that a loss does not move get no gradient, and nothing is recorded. Tests compare all gradients with autograd's.
"""

from collections.abc import Callable
from typing import Any, cast

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import NormalParamExtractor, biased_softplus, dispatch
from torch import Tensor
from torchrl.objectives import LossModule, SACLoss, SoftUpdate, ValueEstimators
from torchrl.objectives.utils import distance_loss

from auv_torchrl.agents.networks import ACTION_LIMIT, Layers, perceptron, perceptron_values, tanh_normal

_ops: Any = torch.ops.aten
_SLOPES: dict[str, Callable[[Tensor], Tensor]] = {  # of TorchRL's distances, by how far apart the values are
    "l1": torch.sign,
    "l2": lambda apart: 2 * apart,
    "smooth_l1": lambda apart: apart.clamp(-1, 1),
}


class FusedSACLoss(SACLoss):
    """``SACLoss`` (second version, TD(0)) without its overhead; same parameters, losses, gradients.

    Critics run stacked in one batched product, the tanh-normal is written out, and no vmap, no functional call and
    no distribution object is made. Needs the networks of :mod:`auv_torchrl.agents.networks`.
    """

    has_closed_form = True  # of its gradients, see :class:`ClosedForm`
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


class ClosedForm:
    """Losses of a :class:`FusedSACLoss` and the gradients of their sum, put into ``grad`` of its parameters.

    Random numbers are drawn in the order of the loss itself, so that both see the same.
    """

    def __init__(self, loss: FusedSACLoss):
        self.loss = loss

    @torch.no_grad()
    def __call__(self, batch: TensorDictBase, actor: bool) -> TensorDictBase:
        """Losses of a batch (B,), and the gradients; without ``actor`` those of the critics alone."""
        loss, following = self.loss, batch.get("next")
        observation, alpha = batch.get("observation"), loss.log_alpha.exp()
        sampled = _Sampled(loss, observation, following.get("observation"))
        target = loss.target(following, alpha, *sampled.following)
        critics = loss.layers("qvalue_network_params")
        stored = torch.cat((observation, batch.get("action")), -1)
        imagined = torch.cat((observation, sampled.action), -1)
        values = perceptron_values(critics, torch.cat((stored, imagined)))
        count = len(stored)
        value, imagined_value = values[-1].split(count, dim=1)
        apart = value - target
        least = imagined_value.amin(0)
        slopes = torch.cat(
            (_SLOPES[loss.loss_function](apart) / count, (imagined_value == least) * (-1 / count)), dim=1
        )
        by_action = _backward(critics, values, slopes, moved=slice(0, count), wanted=slice(count, None))
        entropy = -sampled.log_prob.mean()
        if actor:
            sampled.backward(by_action[..., -sampled.action.shape[-1] :].sum(0), alpha / count)
            loss.log_alpha.grad = entropy - loss.target_entropy
        else:
            for weight in (loss.log_alpha, *(each for layer in loss.layers("actor_network_params") for each in layer)):
                weight.grad = None
        losses = {
            "loss_actor": -alpha * entropy - least.mean(),
            "loss_qvalue": distance_loss(value, target.expand_as(value), loss.loss_function).sum() / count,
            "loss_alpha": loss.log_alpha * (entropy - loss.target_entropy),
            "alpha": alpha,
            "entropy": entropy,
        }
        return TensorDict(losses, [])


class _Sampled:
    """What the actor does in observations (B, d) now, and in those that follow."""

    def __init__(self, loss: FusedSACLoss, now: Tensor, later: Tensor):
        self._layers, self._extract = loss.layers("actor_network_params"), loss.extract
        self._values = perceptron_values(self._layers, torch.cat((now, later)))
        loc, scale = self._extract(self._values[-1])
        count = len(now)
        noise_later, self._noise = torch.randn_like(loc[count:]), torch.randn_like(loc[:count])
        drawn = tanh_normal(loc, scale, torch.cat((self._noise, noise_later)))
        self._squashed, self.action, self.log_prob = (part[:count] for part in drawn)
        self.following = drawn[1][count:], drawn[2][count:]
        self._scale = scale[:count]

    def backward(self, by_action: Tensor, per_log_prob: Tensor) -> None:
        """Gradients of the actor's weights, from those of a loss by actions (B, a) and by log-probabilities ()."""
        squashed, mapping = self._squashed, cast(biased_softplus, self._extract.scale_mapping)
        inside = by_action * (squashed.abs() <= ACTION_LIMIT)
        by_raw = inside - inside * squashed.square() + (2 * per_log_prob) * squashed
        by_scale = by_raw * self._noise - per_log_prob / self._scale
        count = len(squashed)
        values = [value[:count] for value in self._values]
        unmapped = values[-1][:, squashed.shape[-1] :] + mapping.bias  # the scale is softplus of it, and a constant
        _backward(self._layers, values, torch.cat((by_raw, by_scale * unmapped.sigmoid()), -1), slice(None))


def _backward(layers: Layers, values: list[Tensor], slope: Tensor, moved: slice, wanted: slice | None = None) -> Tensor:
    """Gradients of the weights from the ``slope`` of a loss by what comes out; returns those by ``wanted`` inputs.

    Args:
        layers: the perceptrons.
        values: of :func:`~auv_torchrl.agents.networks.perceptron_values`.
        slope: (..., B, outputs).
        moved: rows whose part of the loss moves the weights.
        wanted: rows of whose inputs gradients are wanted; None for none.
    """
    for i in reversed(range(len(layers))):
        weight, bias = layers[i]
        some = slope[..., moved, :]
        weight.grad, bias.grad = some.mT @ values[i][..., moved, :], some.sum(-2)
        if i:
            slope = _ops.threshold_backward(slope @ weight, values[i], 0)
        elif wanted is not None:
            return slope[..., wanted, :] @ weight
    return slope


class FusedSoftUpdate(SoftUpdate):
    """``SoftUpdate`` in one call over all tensors: 4 us instead of 145 us for twin critics."""

    def __init__(self, loss: SACLoss, *, tau: float):
        super().__init__(loss, tau=tau)
        self._share = tau
        self._online = [p.data for p in leaves(loss, "qvalue_network_params")]
        self._target = [p.data for p in leaves(loss, "target_qvalue_network_params")]

    def step(self) -> None:
        """Move the target critics towards the critics."""
        torch._foreach_lerp_(self._target, self._online, self._share)  # pyright: ignore[reportPrivateImportUsage]


def leaves(loss: LossModule, network: str) -> list[Tensor]:
    """The tensors of one of the loss's networks, in a fixed order."""
    return list(getattr(loss, network).values(include_nested=True, leaves_only=True))
