"""Actor, critics and their averages, and the transitions that they learn from."""

from typing import Any

import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModuleBase
from torch import Tensor
from torch.optim.swa_utils import get_ema_multi_avg_fn
from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer

from auv_torchrl.agents.config import AgentConfig
from auv_torchrl.agents.losses import make_loss
from auv_torchrl.agents.networks import make_policy
from auv_torchrl.agents.updater import Updater, leaves

STORED = (
    "observation",
    "action",
    ("next", "observation"),
    ("next", "reward"),
    ("next", "done"),
    ("next", "terminated"),
)
LOSS_KEYS = ("loss_qvalue", "loss_actor", "alpha", "entropy")


class Learner:
    """What soft actor-critic learns with: networks, optimiser and replay buffer, on one device.

    Args:
        observations: their number.
        actions: their number.
        config: settings.
        device: where it all lies.
    """

    def __init__(self, observations: int, actions: int, config: AgentConfig, device: torch.device):
        self.config, self.device = config, device
        self.network = {"observations": observations, "actions": actions, "hidden": list(config.hidden)}
        loss = make_loss(
            config.loss, **self.network, gamma=config.gamma,
            target_entropy=config.target_entropy, alpha_init=config.alpha_init,
            device=device,
        )  # fmt: skip
        self.updater = Updater(loss, config.learning_rate, config.alpha_learning_rate, config.tau)
        self.exploring, self.averaged, self.best = (make_policy(**self.network, device=device) for _ in range(3))
        self._actor = [p.data for p in leaves(loss, "actor_network_params")]
        self._average = [p.data for p in self.averaged.parameters()]
        for shared, average, weight in zip(self.exploring.parameters(), self._average, self._actor, strict=True):
            shared.data = weight  # what explores is the actor itself
            average.copy_(weight)
        self._move_average = get_ema_multi_avg_fn(config.average)  # AveragedModel sorts all weights anew at every step
        self.buffer = TensorDictReplayBuffer(
            storage=LazyTensorStorage(config.buffer_size, device=device),
            batch_size=config.batch_size * config.updates_per_step * config.steps_per_batch,
        )

    def start_from(self, policy: TensorDictModuleBase) -> None:
        """Begin with the weights of a policy of the same network instead of random ones."""
        for module in (self.averaged, self.best):
            module.load_state_dict(policy.state_dict())
        for weight, start in zip(self._actor, self.averaged.parameters(), strict=True):
            weight.copy_(start.data)

    def remember(self, data: TensorDict) -> None:
        """Keep transitions (N, steps) in the buffer."""
        self.buffer.extend(data.select(*STORED).reshape(-1))

    def update(self, fraction: float, actor: bool) -> dict[str, Tensor]:
        """The updates that are due after one batch of transitions.

        Args:
            fraction: of the training that is done, which lowers the learning rate.
            actor: update it too, not the critics alone.

        Returns:
            The means of their losses, by ``LOSS_KEYS``.
        """
        config = self.config
        self.updater.scale_learning_rate(1 + (config.learning_rate_end - 1) * fraction)
        losses = []
        for batch in self.buffer.sample().split(config.batch_size):
            losses.append(self.updater.step(batch, actor))
            self._move_average(self._average, self._actor, 0)
        return {key: torch.stack([loss[key].detach() for loss in losses]).mean() for key in LOSS_KEYS}

    def keep_best(self) -> None:
        """Take the averaged weights for the best ones."""
        self.best.load_state_dict(self.averaged.state_dict())

    def state_dict(self) -> dict[str, Any]:
        """Everything that what follows depends on."""
        # cloned, because saving a slice would write the memory of the whole buffer
        stored = self.buffer[:].clone().flatten_keys(".").to_dict() if len(self.buffer) else {}
        return {
            "updater": self.updater.state_dict(),
            "averaged": self.averaged.state_dict(),
            "best": self.best.state_dict(),
            "transitions": {key: value for key, value in stored.items() if key != "index"},
            "cursor": self.buffer.writer.state_dict(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from :meth:`state_dict`."""
        self.updater.load_state_dict(state["updater"])
        self.averaged.load_state_dict(state["averaged"])
        self.best.load_state_dict(state["best"])
        if state["transitions"]:
            transitions = TensorDict(state["transitions"], device=self.device).auto_batch_size_(1).unflatten_keys(".")
            self.buffer.empty()
            self.buffer.extend(transitions)
        self.buffer.writer.load_state_dict(state["cursor"])
