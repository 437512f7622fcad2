"""Soft actor-critic trained on, on the target itself: what u_s becomes with the seconds of flight that a map gets.

Haarnoja et al. 2018 (*Soft Actor-Critic Algorithms and Applications*, arXiv:1812.05905, section 7, learning on the
robot itself); several updates for each transition, as Smith, Kostrikov and Levine 2022 (*A Walk in the Park*,
arXiv:2208.07860) need to learn from minutes of data.
"""

from dataclasses import dataclass, replace
from typing import Any

import torch
from tensordict.nn import TensorDictModuleBase

from auv_torchrl.agents.config import FineTuning, SACConfig
from auv_torchrl.agents.learning.learners import make_learner
from auv_torchrl.agents.policy import SourcePolicy
from auv_torchrl.envs import FleetEnv

UPDATES = 5  # for each transition
CRITICS_ALONE = 0.25  # share of the flight in which critics that know nothing learn to judge u_s before it moves
LEARNING_RATE = 3e-4  # a tenth of that of a training that begins with nothing


@dataclass(frozen=True)
class Retrained:
    """A policy and what it was trained on."""

    policy: TensorDictModuleBase
    target_data_s: float


def retrain(policy: SourcePolicy, target: FleetEnv, seconds: float, agent: SACConfig, seed: int = 0) -> Retrained:
    """Fly the target with the policy, which explores, and train it on with each transition as it comes.

    Nothing is examined on the way: an examination would be more flight of the target.

    Args:
        policy: u_s, as it was trained; its temperature is where this training begins.
        target: target vehicles, which fly at the same time, and take channels.
        seconds: of flight, of all vehicles together.
        agent: settings of the training of u_s.
        seed: of the exploration and the new critics.
    """
    steps = round(seconds / target.task.control_dt / target.num_envs)
    frames = steps * target.num_envs
    tuning = FineTuning(total_frames=frames, learning_rate=LEARNING_RATE)
    tuned: Any = agent.tuned(tuning, policy.metadata["curve"][-1])
    tuned = replace(
        tuned, num_envs=target.num_envs, stretch_steps=steps,
        steps_per_batch=next(n for n in range(5, steps + 1) if steps % n == 0),
        updates_per_step=UPDATES * target.num_envs, buffer_size=frames,
    )  # fmt: skip
    assert target.device is not None
    with torch.random.fork_rng(devices=()):
        torch.manual_seed(seed)
        sizes = target.observation_spec["observation"].shape[-1], target.action_spec.shape[-1]
        learner = make_learner(tuned, *sizes, target.device)
        learner.start_from(policy.module)
        for _ in learner.learn(target, 0, round(CRITICS_ALONE * frames)):
            pass
    return Retrained(learner.averaged.eval(), seconds)
