"""What learns: a policy, its averaged and its best weights, and what an agent adds to learn them."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModuleBase
from torch import Tensor
from torch.optim.swa_utils import get_ema_multi_avg_fn
from torchrl.collectors import Collector
from torchrl.envs import EnvBase

from auv_torchrl.agents.config import AgentConfig
from auv_torchrl.agents.networks import make_policy


class Learnt(NamedTuple):
    """What became of one batch of transitions."""

    frames: int  # transitions
    reward: Tensor  # () mean
    losses: Mapping[str, Tensor] | None  # by ``Learner.losses``; None where nothing was updated


class Learner(ABC):
    """Networks and what teaches them, on one device.

    Args:
        observations: their number.
        actions: their number.
        config: settings.
        device: where it all lies.
    """

    losses: tuple[str, ...]  # what it tells of an update; anything that is no finite number has diverged

    def __init__(self, observations: int, actions: int, config: AgentConfig, device: torch.device):
        self.device = device
        self.network = {"observations": observations, "actions": actions, "hidden": list(config.hidden)}
        self.exploring, self.averaged, self.best = (make_policy(**self.network, device=device) for _ in range(3))
        self._average = [p.data for p in self.averaged.parameters()]
        self._actor: list[Tensor] = []
        self._moves = 0  # of the average

    @abstractmethod
    def learn(self, fleet: EnvBase, before: int, critics_alone: int) -> Iterator[Learnt]:
        """Learn for one stretch.

        Args:
            fleet: to fly, fresh.
            before: transitions of the stretches before.
            critics_alone: transitions, from the first on, in which a policy that was handed over does not move.
        """

    def _follow(self, actor: list[Tensor]) -> None:
        """Let what explores, and at first the average, have these weights, which updates then change in place."""
        self._actor = actor
        for shared, average, weight in zip(self.exploring.parameters(), self._average, actor, strict=True):
            shared.data = weight
            average.copy_(weight)

    def _move_average(self, share: float) -> None:
        """Keep ``share`` of the averaged weights, at first less, and take the rest from the policy's.

        The average reaches back over no more than the last tenth of the updates: what was learnt first is soon outdone.
        """
        self._moves += 1
        kept = min(share, self._moves / (self._moves + 10))
        get_ema_multi_avg_fn(kept)(self._average, self._actor, 0)  # AveragedModel sorts all weights anew at every step

    def start_from(self, policy: TensorDictModuleBase) -> None:
        """Begin with the weights of a policy of the same network instead of random ones."""
        for module in (self.averaged, self.best):
            module.load_state_dict(policy.state_dict())
        for weight, start in zip(self._actor, self.averaged.parameters(), strict=True):
            weight.copy_(start.data)

    def keep_best(self) -> None:
        """Take the averaged weights for the best ones."""
        self.best.load_state_dict(self.averaged.state_dict())

    def parts(self) -> dict[str, Any]:
        """What has a state of its own that what follows depends on, by name."""
        return {"averaged": self.averaged, "best": self.best}

    def state_dict(self) -> dict[str, Any]:
        """Everything that what follows depends on."""
        return {**{name: part.state_dict() for name, part in self.parts().items()}, "moves": self._moves}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from :meth:`state_dict`."""
        for name, part in self.parts().items():
            part.load_state_dict(state[name])
        self._moves = state["moves"]


def collected(
    fleet: EnvBase, policy: TensorDictModuleBase, config: AgentConfig, random_frames: int = 0
) -> Iterator[TensorDict]:
    """Transitions (N, steps_per_batch) of one stretch; random actions in the batches of the first ``random_frames``."""
    batch = config.num_envs * config.steps_per_batch
    collector = Collector(
        fleet,
        policy,
        frames_per_batch=batch,
        total_frames=config.stretch_frames,
        init_random_frames=-(-random_frames // batch) * batch,
        trust_policy=True,
        auto_register_policy_transforms=False,
    )
    yield from collector
    collector.shutdown()
