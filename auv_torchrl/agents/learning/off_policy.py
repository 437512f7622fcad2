"""Agents that learn from a replay buffer: the transitions, and when they are learnt from."""

from collections.abc import Iterator
from typing import Any

import torch
from tensordict import TensorDict
from torch import Tensor
from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer
from torchrl.envs import EnvBase

from auv_torchrl.agents.config import OffPolicyConfig
from auv_torchrl.agents.learning.learner import Learner, Learnt, collected

STORED = (
    "observation",
    "action",
    ("next", "observation"),
    ("next", "reward"),
    ("next", "done"),
    ("next", "terminated"),
)


class OffPolicyLearner(Learner):
    """Collects, remembers, updates; arguments are those of every :class:`Learner`."""

    def __init__(self, observations: int, actions: int, config: OffPolicyConfig, device: torch.device):
        self.config = config
        self.updater = config.make_updater(observations, actions, device)
        self.losses = self.updater.curves
        super().__init__(observations, actions, config, device)
        self._follow(self.updater.actor)
        self.buffer = TensorDictReplayBuffer(
            storage=LazyTensorStorage(config.buffer_size, device=device),
            batch_size=config.batch_size * config.updates_per_step * config.steps_per_batch,
        )

    def learn(self, fleet: EnvBase, before: int, critics_alone: int) -> Iterator[Learnt]:
        """Collect, remember, update."""
        config, frames = self.config, before
        for data in collected(fleet, self.exploring, config, max(0, config.random_frames - before)):
            self.buffer.extend(data.select(*STORED).reshape(-1))
            frames += data.numel()
            losses = None
            if frames > config.random_frames:
                losses = self._update(frames, actor=frames > critics_alone)
            yield Learnt(data.numel(), data["next", "reward"].mean(), losses)

    def _update(self, frames: int, actor: bool) -> dict[str, Tensor]:
        """The updates that are due after one batch of transitions.

        Args:
            frames: transitions until now, which lower the learning rate.
            actor: update it too, not the critics alone.

        Returns:
            The means of their losses.
        """
        config = self.config
        self.updater.scale_learning_rate(config.learning_rate_factor(frames))
        losses = []
        for batch in self.buffer.sample().split(config.batch_size):
            losses.append(self.updater.step(batch, actor))
            self._move_average(config.average)
        return {key: torch.stack([loss[key].detach() for loss in losses]).mean() for key in self.losses}

    def parts(self) -> dict[str, Any]:
        """The updater, too."""
        return {**super().parts(), "updater": self.updater}

    def state_dict(self) -> dict[str, Any]:
        """Everything that what follows depends on, the transitions included."""
        # cloned, because saving a slice would write the memory of the whole buffer
        stored = self.buffer[:].clone().flatten_keys(".").to_dict() if len(self.buffer) else {}
        return {
            **super().state_dict(),
            "transitions": {key: value for key, value in stored.items() if key != "index"},
            "cursor": self.buffer.writer.state_dict(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from :meth:`state_dict`."""
        super().load_state_dict(state)
        if state["transitions"]:
            transitions = TensorDict(state["transitions"], device=self.device).auto_batch_size_(1).unflatten_keys(".")
            self.buffer.empty()
            self.buffer.extend(transitions)
        self.buffer.writer.load_state_dict(state["cursor"])
