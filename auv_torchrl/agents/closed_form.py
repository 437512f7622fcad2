"""The gradients of soft actor-critic written out: what autograd finds for its losses, with half of the work.

Observations of a transition and of the one after go through the actor at once, as do sampled and stored actions through
the critics; weights that a loss does not move get no gradient, and nothing is recorded.
"""

from collections.abc import Callable
from typing import Any, cast

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import biased_softplus
from torch import Tensor
from torchrl.objectives.utils import distance_loss

from auv_torchrl.agents.losses import FusedSACLoss
from auv_torchrl.agents.networks import ACTION_LIMIT, Layers, perceptron_values, tanh_normal

_ops: Any = torch.ops.aten
_SLOPES: dict[str, Callable[[Tensor], Tensor]] = {  # of TorchRL's distances, by how far apart the values are
    "l1": torch.sign,
    "l2": lambda apart: 2 * apart,
    "smooth_l1": lambda apart: apart.clamp(-1, 1),
}


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
