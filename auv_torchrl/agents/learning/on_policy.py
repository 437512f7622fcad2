"""Proximal policy optimisation (Schulman et al. 2017): what was just flown is learnt from a few times."""

from collections.abc import Iterator
from typing import Any

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.data import LazyTensorStorage, SamplerWithoutReplacement, TensorDictReplayBuffer
from torchrl.envs import EnvBase
from torchrl.objectives.value import GAE

from auv_torchrl.agents.config import PPOConfig
from auv_torchrl.agents.learning.learner import Learner, Learnt, collected
from auv_torchrl.agents.learning.losses import make_ppo_loss
from auv_torchrl.agents.learning.updater import leaves


class OnPolicyLearner(Learner):
    """Flies with the policy as it is, weighs what followed, and climbs within a clip; arguments as of every learner."""

    losses = ("loss_critic", "loss_objective", "entropy")

    def __init__(self, observations: int, actions: int, config: PPOConfig, device: torch.device):
        super().__init__(observations, actions, config, device)
        self.config = config
        self.actor, critic, self.loss = make_ppo_loss(
            observations, actions, config.hidden, clip=config.clip, entropy=config.entropy, device=device
        )
        self.advantage = GAE(gamma=config.gamma, lmbda=config.trace, value_network=critic)
        self._follow([weight.data for weight in leaves(self.loss, "actor_network_params")])
        self.optimiser = torch.optim.Adam(self.loss.parameters(), lr=config.learning_rate, fused=True)
        self.flown = TensorDictReplayBuffer(
            storage=LazyTensorStorage(config.num_envs * config.steps_per_batch, device=device),
            sampler=SamplerWithoutReplacement(),
            batch_size=config.batch_size,
        )

    def learn(self, fleet: EnvBase, before: int, critics_alone: int) -> Iterator[Learnt]:
        """Fly, weigh, climb."""
        config, frames = self.config, before
        for data in collected(fleet, self.actor, config):
            frames += data.numel()
            yield Learnt(data.numel(), data["next", "reward"].mean(), self._update(data, frames, critics_alone))

    def _update(self, data: TensorDictBase, frames: int, critics_alone: int) -> dict[str, Tensor]:
        """Several times through transitions (N, T), in the order of time; the means of the losses."""
        config = self.config
        for group in self.optimiser.param_groups:
            group["lr"] = config.learning_rate * config.learning_rate_factor(frames)
        with torch.no_grad():
            self.advantage(data)
        self.flown.empty()
        self.flown.extend(data.reshape(-1))
        batches = []
        for _ in range(config.epochs):
            for batch in self.flown:
                losses = self.loss(batch)
                total = losses["loss_critic"]
                if frames > critics_alone:
                    total = total + losses["loss_objective"] + losses["loss_entropy"]
                self.optimiser.zero_grad(set_to_none=True)
                total.backward()
                torch.nn.utils.clip_grad_norm_(self.loss.parameters(), config.gradient_norm)
                self.optimiser.step()
                self._move_average(config.average)
                batches.append(losses.detach())
        return {name: torch.stack([losses[name].mean() for losses in batches]).mean() for name in self.losses}

    def parts(self) -> dict[str, Any]:
        """Loss and optimiser, too; what was flown is forgotten when a state is kept."""
        return {**super().parts(), "loss": self.loss, "optimiser": self.optimiser}
