"""Actor, critics and the policy that leaves the training."""

import math
from collections.abc import Sequence

import torch
import torch.nn.functional as F
from tensordict.nn import NormalParamExtractor, TensorDictModule
from torch import Tensor, nn
from torchrl.envs.utils import ExplorationType, exploration_type
from torchrl.modules import MLP, ProbabilisticActor, TanhNormal, ValueOperator

ACTION_LIMIT = 1.0 - torch.finfo(torch.float32).resolution  # as TanhNormal with safe_tanh
LOG_ROOT_TWO_PI = 0.9189385332046727  # log(sqrt(2 pi))
LOG_TWO = 0.6931471805599453

Device = torch.device | str
Layers = Sequence[tuple[Tensor, Tensor]]


def make_network(inputs: int, outputs: int, hidden: Sequence[int], device: Device) -> MLP:
    """The perceptron that actor and critics are."""
    return MLP(inputs, outputs, num_cells=list(hidden), activation_class=nn.ReLU, device=device)


def make_actor(observations: int, actions: int, hidden: Sequence[int], device: Device = "cpu") -> ProbabilisticActor:
    """Tanh-normal actor: observation (..., observations) to loc, scale and action (..., actions) in (-1, 1)."""
    network = make_network(observations, 2 * actions, hidden, device)
    return ProbabilisticActor(
        TensorDictModule(
            nn.Sequential(network, NormalParamExtractor()), in_keys=["observation"], out_keys=["loc", "scale"]
        ),
        in_keys=["loc", "scale"],
        distribution_class=TanhNormal,
        default_interaction_type=ExplorationType.DETERMINISTIC,
        return_log_prob=True,
    )


def make_critic(observations: int, actions: int, hidden: Sequence[int], device: Device = "cpu") -> ValueOperator:
    """Q(s, a) of shape (..., 1); the loss makes and stacks as many copies as it needs."""
    return ValueOperator(make_network(observations + actions, 1, hidden, device), in_keys=["observation", "action"])


def make_value(observations: int, hidden: Sequence[int], device: Device = "cpu") -> ValueOperator:
    """V(s) of shape (..., 1)."""
    return ValueOperator(make_network(observations, 1, hidden, device), in_keys=["observation"])


class TanhPolicy(nn.Module):
    """The actor by hand: tanh of the mean, or a sample inside ``set_exploration_type(RANDOM)``.

    Takes 50 us at 64 rows, where going through ``TanhNormal`` takes 400 us.
    """

    def __init__(self, observations: int, actions: int, hidden: Sequence[int], device: Device = "cpu"):
        super().__init__()
        self.actions = actions
        self.network = make_network(observations, 2 * actions, hidden, device)
        self.extract = NormalParamExtractor()

    def forward(self, observation: Tensor) -> Tensor:
        """Observation (..., d) to action (..., a) in [-1, 1]."""
        output = self.network(observation)
        if exploration_type() is ExplorationType.RANDOM:
            loc, scale = self.extract(output)
            return torch.addcmul(loc, scale, torch.randn_like(loc)).tanh_()
        return output[..., : self.actions].tanh()


def make_policy(observations: int, actions: int, hidden: Sequence[int], device: Device = "cpu") -> TensorDictModule:
    """Observation -> action; deterministic outside ``set_exploration_type(RANDOM)``."""
    policy = TanhPolicy(observations, actions, hidden, device)
    return TensorDictModule(policy, in_keys=["observation"], out_keys=["action"])


def set_spread(policy: TensorDictModule, spread: float) -> None:
    """Give a policy of :func:`make_policy` one standard deviation before its tanh, whatever it observes."""
    *_, weight, bias = policy.parameters()
    with torch.no_grad():
        weight[len(weight) // 2 :] = 0.0
        bias[len(bias) // 2 :] = math.log(math.expm1(spread) / math.expm1(1.0))  # the extractor's softplus is 1 at 0


def perceptron(layers: Layers, x: Tensor) -> Tensor:
    """Layers with ReLU between them on ``x`` (B, d): weights (out, in), or (k, out, in) for k networks at once."""
    return perceptron_values(layers, x)[-1]


def perceptron_values(layers: Layers, x: Tensor) -> list[Tensor]:
    """What goes into each layer of :func:`perceptron`, and what comes out of the last."""
    stacked = layers[0][0].ndim == 3
    values = [x.expand(len(layers[0][0]), *x.shape) if stacked else x]
    for i, (weight, bias) in enumerate(layers):
        if i:
            values[-1].relu_()  # no gradient needs the value before
        x = values[-1]
        values.append(torch.baddbmm(bias.unsqueeze(-2), x, weight.mT) if stacked else torch.addmm(bias, x, weight.mT))
    return values


def tanh_normal(loc: Tensor, scale: Tensor, noise: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Tanh (B, a) of the sample that standard normal noise makes, the action (B, a), and its log-probability (B,).

    Action and log-probability are those of ``TanhNormal.rsample_and_log_prob``.
    """
    raw = torch.addcmul(loc, scale, noise)
    squashed = raw.tanh()
    # log N(raw) - log(1 - tanh(raw)^2), the latter in the form that cannot overflow
    density = 2 * (raw + F.softplus(-2 * raw)) - scale.log() - 0.5 * noise.square()
    log_prob = density.sum(-1) - loc.shape[-1] * (LOG_ROOT_TWO_PI + 2 * LOG_TWO)
    return squashed, squashed.clamp(-ACTION_LIMIT, ACTION_LIMIT), log_prob
