"""A policy that is conditioned on its history: what it is told of the vehicle in training it infers in flight.

Kumar, Fu, Pathak and Malik 2021, *RMA: Rapid Motor Adaptation for Legged Robots* (arXiv:2107.04034); Zhang et al. 2023
fly quadrotors so (*Learning a Single Near-hover Position Controller for Vastly Different Quadcopters*,
arXiv:2209.09232). Two phases: a policy is trained on randomized vehicles and is told what was drawn; then an encoder of
the last half second learns to say the same from observations and actions alone, on flights that its own answers steer.
The gains of a vehicle's thrusters are few numbers, so the policy gets them as they are, not through a network first.
"""

import logging
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, cast

import torch
from tensordict import TensorDictBase
from torch import Tensor, nn
from torchrl.data import Composite, TensorSpec, Unbounded
from torchrl.envs import CatTensors, Compose, EnvBase, TransformedEnv
from torchrl.envs.transforms import Transform

from auv_torchrl.agents.config import AgentConfig
from auv_torchrl.agents.policy import SourcePolicy
from auv_torchrl.agents.train_source import describe, kept_or_trained, make_examiner
from auv_torchrl.agents.trainer import Trainer
from auv_torchrl.envs import RandomizeVehicle, make_fleet
from auv_torchrl.tasks import Task
from auv_torchrl.vehicle import Vehicle

DRAWN, INFERRED, OBSERVATION, HISTORY = "told", "inferred", "observation", "history"
HISTORY_S = 0.5
CHANGES = 20.0  # by which changes of an observation in a control step are multiplied
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class EncoderConfig:
    """How the second phase is trained."""

    rounds: int = 4  # of flights, each steered by the encoder of the round before
    vehicles: int = 4096  # of a round: those that are drawn have to fill the ranges
    steps: int = 20  # of each flight
    updates: int = 1500  # per round, on the flights of all rounds
    batch_size: int = 1024
    learning_rate: float = 1e-3


class Encoder(nn.Module):
    """From (N, steps, observations + actions), oldest first, to (N, k) numbers.

    It sees changes of the observation in large: a thrust changes a speed by hundredths in a control step.

    Args:
        sizes: number of observations and of actions.
        steps: of a history.
        count: k.
    """

    def __init__(self, sizes: tuple[int, int], steps: int, count: int):
        super().__init__()
        self.observations = sizes[0]
        inputs = steps * sum(sizes) + (steps - 1) * sizes[0]
        self.layers = nn.Sequential(
            nn.Linear(inputs, 256), nn.ReLU(), nn.Linear(256, 128), nn.ReLU(), nn.Linear(128, count)
        )

    def forward(self, history: Tensor) -> Tensor:
        """What is inferred."""
        change = CHANGES * history[..., : self.observations].diff(dim=-2)
        return self.layers(torch.cat((history.flatten(-2), change.flatten(-2)), -1))


class Infer(Transform):
    """Writes what the encoder infers from the last half second of each vehicle, and that half second itself.

    Args:
        encoder: from (N, steps, observations + actions), oldest first, to (N, k).
        sizes: number of observations and of actions.
        steps: control steps of a history.
    """

    def __init__(self, encoder: nn.Module, sizes: tuple[int, int], steps: int):
        super().__init__(in_keys=[OBSERVATION], out_keys=[INFERRED, HISTORY])
        self.encoder, self.sizes, self.steps = encoder, sizes, steps
        self._history = self._now = torch.zeros(0)

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        newest = torch.cat((self._now, tensordict.get("action")), -1)
        self._history = torch.cat((self._history[:, 1:], newest[:, None]), 1)
        return self._say(next_tensordict)

    def _reset(self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase) -> TensorDictBase:
        observation = tensordict_reset.get(OBSERVATION)
        mask = tensordict.get("_reset", None)
        if mask is None or len(self._history) != len(observation):
            self._history = observation.new_zeros(len(observation), self.steps, sum(self.sizes))
        else:
            self._history = torch.where(mask.reshape(-1, 1, 1), 0.0, self._history)
        return self._say(tensordict_reset)

    @torch.no_grad()
    def _say(self, tensordict: TensorDictBase) -> TensorDictBase:
        self._now = tensordict.get(OBSERVATION)
        return tensordict.set(INFERRED, self.encoder(self._history)).set(HISTORY, self._history)

    def transform_observation_spec(self, observation_spec: TensorSpec) -> TensorSpec:
        """Declare both."""
        spec = cast(Composite, observation_spec)
        count = self.encoder(torch.zeros(1, self.steps, sum(self.sizes))).shape[-1]
        for key, size in ((INFERRED, (count,)), (HISTORY, (self.steps, sum(self.sizes)))):
            spec[key] = Unbounded(torch.Size((*spec.shape, *size)), dtype=torch.float32, device=spec.device)
        return spec


@dataclass(frozen=True)
class HistoryPolicy:
    """A policy that was told, and the encoder that stands in for being told."""

    policy: SourcePolicy
    encoder: nn.Module
    sizes: tuple[int, int]  # observations and actions
    steps: int  # of a history

    def parts(self) -> list[Transform]:
        """What stands between a fleet and the policy: it infers, and adds that to the observation."""
        return [Infer(self.encoder, self.sizes, self.steps), joined(INFERRED)]

    def transform(self) -> Compose:
        """The same in one."""
        return Compose(self.parts())


def joined(key: str) -> CatTensors:
    """What is known of the vehicle as a part of the observation."""
    return CatTensors([key, OBSERVATION], OBSERVATION, dim=-1, del_keys=False, sort=False)


def train_informed(
    vehicle: Vehicle, task: Task, agent: AgentConfig, ranges: Mapping[str, Any], seed: int, backend: str, folder: Path
) -> SourcePolicy:
    """The first phase: a policy that is told what was drawn; kept and found again as every source policy.

    Args:
        vehicle: nominal vehicle, empty batch.
        task: to train on.
        agent: settings of the training.
        ranges: of the randomization.
        seed: of everything random.
        backend: "mujoco" or "torch".
        folder: the store.
    """

    def around(fleet: EnvBase, own_seed: int) -> EnvBase:
        drawn = RandomizeVehicle(vehicle, ranges, seed=own_seed, entry=DRAWN)
        parts: list[Transform] = [drawn, joined(DRAWN)]
        return TransformedEnv(fleet, Compose(parts))

    def trainer(training: Path, key: str) -> Trainer:
        def make(own_seed: int) -> EnvBase:
            return around(agent.make_fleet(backend, vehicle, task, own_seed, "cpu"), own_seed)

        examiner = make_examiner(vehicle, task, agent, backend, lambda fleet: around(fleet, 0))
        return Trainer(make, examiner, agent, seed, training, key)

    return kept_or_trained(
        {**describe(vehicle, task, agent, ranges, seed, backend), "told": True}, trainer, folder, "cpu"
    )


def train_encoder(
    policy: SourcePolicy,
    vehicle: Vehicle,
    task: Task,
    ranges: Mapping[str, Any],
    backend: str,
    config: EncoderConfig | None = None,
    seed: int = 0,
) -> HistoryPolicy:
    """The second phase: flights that the encoder steers, and what was really drawn, by least squares.

    Args:
        policy: of :func:`train_informed`.
        vehicle: nominal vehicle, empty batch.
        task: that it was trained on.
        ranges: that it was trained over.
        backend: "mujoco" or "torch".
        config: settings.
        seed: of everything random.
    """
    config = config or EncoderConfig()
    steps = round(HISTORY_S / task.control_dt)
    fleet = make_fleet(backend, vehicle, task, config.vehicles, seed=seed)
    sizes = fleet.observation_spec[OBSERVATION].shape[-1], fleet.action_spec.shape[-1]
    with torch.random.fork_rng(devices=()):
        torch.manual_seed(seed)
        drawn_count = policy.metadata["network"]["observations"] - sizes[0]
        encoder = Encoder(sizes, steps, drawn_count)
        made = HistoryPolicy(policy, encoder, sizes, steps)
        drawn = RandomizeVehicle(vehicle, ranges, seed=seed, entry=DRAWN)
        parts: list[Transform] = [drawn, *made.parts()]
        env = TransformedEnv(fleet, Compose(parts))
        flown: list[tuple[Tensor, Tensor]] = []
        for number in range(config.rounds):
            with torch.no_grad():
                data = env.rollout(config.steps, policy.module, break_when_any_done=False)["next"]
            flown.append((data[HISTORY].flatten(0, 1), data[DRAWN].flatten(0, 1)))
            error = _regress(encoder, flown, config)
            log.info("encoder, round %d: %s, off by %.3f of half a range", number + 1, asdict(config), error)
    encoder.requires_grad_(False).eval()
    return made


def _regress(encoder: nn.Module, flown: list[tuple[Tensor, Tensor]], config: EncoderConfig) -> float:
    """Fit the encoder to all flights; returns the root mean square of what is left in the last batch."""
    history, truth = (torch.cat(parts) for parts in zip(*flown, strict=True))
    adam = torch.optim.Adam(encoder.parameters(), config.learning_rate)
    loss = torch.zeros(())
    for _ in range(config.updates):
        rows = torch.randint(len(history), (config.batch_size,))
        loss = nn.functional.mse_loss(encoder(history[rows]), truth[rows])
        adam.zero_grad()
        loss.backward()
        adam.step()
    return float(loss.detach().sqrt())
