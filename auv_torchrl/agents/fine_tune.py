"""Train a kept policy on, for a vehicle that is known to be different."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from torchrl.envs import EnvBase, TransformedEnv
from torchrl.envs.transforms import Transform

from auv_torchrl.agents.config import AgentConfig, FineTuning
from auv_torchrl.agents.policy import SourcePolicy
from auv_torchrl.agents.train_source import describe, kept_or_trained, make_examiner
from auv_torchrl.agents.trainer import Trainer
from auv_torchrl.envs import RandomizeVehicle
from auv_torchrl.tasks import Task
from auv_torchrl.vehicle import Vehicle
from auv_torchrl.vehicle.changed_file import described


@dataclass(frozen=True)
class Ground:
    """Where a policy is trained on: vehicles around the one that is flown, behind an adapter."""

    vehicle: Vehicle  # by which the best policy is chosen, no batch
    base: Vehicle  # that the ranges are about, no batch
    ranges: Mapping[str, Any]  # as in conf/randomization
    adapter: Callable[[], Transform]  # what stands between policy and fleet
    adapter_name: str  # and what that is: a part of the policy's hash


def fine_tune(
    policy: SourcePolicy,
    ground: Ground,
    task: Task,
    agent: AgentConfig,
    tuning: FineTuning,
    seed: int,
    backend: str,
    folder: Path,
) -> SourcePolicy:
    """The best policy on ``ground`` that training on from ``policy`` finds, ``policy`` itself included.

    Kept and found again as in :func:`auv_torchrl.agents.train_source.train_source`, whose exceptions it shares.

    Args:
        policy: where to start; the training runs on its device.
        ground: what to train on.
        task: of the fleets below the adapter.
        agent: settings of the training that ``policy`` came from; length and learning rate are those of ``tuning``.
        tuning: settings of the training on.
        seed: of everything random.
        backend: "mujoco" or "torch".
        folder: the store.
    """
    agent = agent.tuned(tuning, policy.metadata["curve"][-1])
    device = next(policy.module.parameters()).device
    ingredients = {
        **describe(ground.base, task, agent, ground.ranges, seed, backend, device),
        "from": policy.metadata["hash"],
        "tuning": asdict(tuning),
        "chosen_on": described(ground.vehicle),
        "adapter": ground.adapter_name,
    }

    def training_fleet(fleet_seed: int) -> EnvBase:
        fleet = agent.make_fleet(backend, ground.base, task, fleet_seed, device)
        drawn = RandomizeVehicle(ground.base, agent.ranges(ground.ranges), seed=fleet_seed)
        return TransformedEnv(fleet, drawn).append_transform(ground.adapter())

    def trainer(training: Path, key: str) -> Trainer:
        examiner = make_examiner(
            ground.vehicle, task, agent, backend, lambda fleet: TransformedEnv(fleet, ground.adapter()), device
        )
        made = Trainer(training_fleet, examiner, agent, seed, training, key)
        made.start_from(policy.module, tuning.critic_frames)
        return made

    return kept_or_trained(ingredients, trainer, folder, device)
