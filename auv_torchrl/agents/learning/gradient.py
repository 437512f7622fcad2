"""Analytic policy gradient: the reward of short flights differentiated through the simulator.

As Xu et al. 2022 (ICLR, short-horizon actor-critic), without their critic: a horizon is longer than what a vehicle
remembers of a command.
"""

from collections.abc import Iterator
from typing import Any, cast

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.envs import EnvBase
from torchrl.envs.utils import step_mdp

from auv_torchrl.agents.config import GradientConfig
from auv_torchrl.agents.learning.learner import Learner, Learnt


class GradientLearner(Learner):
    """Climbs the gradient of the mean reward over a horizon; arguments are those of every :class:`Learner`."""

    losses = ("loss_actor", "gradient_norm")

    def __init__(self, observations: int, actions: int, config: GradientConfig, device: torch.device):
        super().__init__(observations, actions, config, device)
        self.config = config
        self._weights = list(self.exploring.parameters())
        self._follow([weight.data for weight in self._weights])
        self.optimiser = torch.optim.Adam(self._weights, lr=config.learning_rate, fused=True)
        self._stuck = torch.tensor(False, device=device)  # whether no horizon of a stretch gave a gradient yet

    def learn(self, fleet: EnvBase, before: int, critics_alone: int) -> Iterator[Learnt]:
        """Fly one horizon after the other from where the vehicles are, and climb after each."""
        config, frames = self.config, before
        batch = config.num_envs * config.steps_per_batch
        state = fleet.reset()
        self._stuck = torch.ones_like(self._stuck)
        for _ in range(config.stretch_steps // config.steps_per_batch):
            state, rewards, flown = self._fly(fleet, self._begin(fleet, state))
            frames += batch
            losses = self._climb((rewards * flown).sum() / flown.sum(), frames)
            yield Learnt(batch, rewards.detach().mean(), losses)

    def _begin(self, fleet: EnvBase, state: TensorDictBase) -> TensorDictBase:
        """The vehicles as they are, without their past; some begin anew, and those whose episode is over."""
        cast(Any, fleet).simulator.cut_gradients()  # transforms hand the attribute on
        state = state.detach()
        drawn = torch.rand(state.batch_size, device=self.device) < self.config.restart
        over = state["done"] | drawn[:, None]
        return fleet.reset(state.set("_reset", over), set_state=False) if over.any() else state

    def _fly(self, fleet: EnvBase, state: TensorDictBase) -> tuple[TensorDictBase, Tensor, Tensor]:
        """Where a horizon leads, the rewards (H, N, 1) on the way, and which of them count: until an episode ends."""
        rewards, flown, running = [], [], ~state["done"]
        for _ in range(self.config.steps_per_batch):
            state = fleet.step(self.exploring(state))
            rewards.append(state["next", "reward"])
            flown.append(running)
            running = running & ~state["next", "done"]
            state = step_mdp(state)
        return state.set("done", ~running), torch.stack(rewards), torch.stack(flown)

    def _climb(self, reward: Tensor, frames: int) -> dict[str, Tensor]:
        config = self.config
        for group in self.optimiser.param_groups:
            group["lr"] = config.learning_rate * config.learning_rate_factor(frames)
        self.optimiser.zero_grad(set_to_none=True)
        (-reward).backward()
        norm = torch.nn.utils.clip_grad_norm_(self._weights, config.gradient_norm)
        for weight in self._weights:  # the gradient of a tumbling vehicle is too long for a number, and points nowhere
            weight.grad = None if weight.grad is None else torch.nan_to_num(weight.grad, 0.0, 0.0, 0.0)
        self.optimiser.step()
        self._move_average(config.average)
        most = torch.finfo(norm.dtype).max
        self._stuck = self._stuck & ~norm.isfinite()  # a stretch without any gradient has diverged
        length = torch.where(self._stuck, norm, torch.nan_to_num(norm, most, most))
        return {"loss_actor": -reward.detach(), "gradient_norm": length}

    def parts(self) -> dict[str, Any]:
        """Policy and optimiser, too."""
        return {**super().parts(), "policy": self.exploring, "optimiser": self.optimiser}
