"""A training so small that it takes a second."""

import os
import signal
import sys
from dataclasses import fields
from pathlib import Path

from auv_torchrl.agents.config import AGENTS, AgentConfig, load_agent_config
from auv_torchrl.agents.policy import SourcePolicy
from auv_torchrl.agents.score import Examiner
from auv_torchrl.agents.train_source import train_source
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import load_vehicle

TASK = StationKeeping(episode_s=1.0, box_m=1.0)
RANDOMIZATION = {"added_mass": {"scale": [0.8, 1.2]}}


SMALL = {
    "hidden": [8, 8], "batch_size": 16, "num_envs": 4, "steps_per_batch": 5, "stretch_steps": 20,
    "updates_per_step": 2, "total_frames": 240, "random_frames": 40, "buffer_size": 150, "evaluation_starts": 3,
}  # fmt: skip


def tiny_config(agent: str = "sac", **changes) -> AgentConfig:
    known = {entry.name for entry in fields(AGENTS[agent])}
    return load_agent_config(agent, {**{key: SMALL[key] for key in SMALL if key in known}, **changes})


def train_tiny(folder: Path, **changes) -> SourcePolicy:
    """``changes`` are arguments of ``train_source``, ``agent``, or settings of that agent."""
    arguments = {
        "vehicle": load_vehicle("paper"), "task": TASK, "randomization": RANDOMIZATION, "seed": 5,
        "backend": "torch", "device": "cpu", "logger": None,
    }  # fmt: skip
    arguments.update({key: changes.pop(key) for key in list(changes) if key in arguments})
    return train_source(agent_config=tiny_config(**changes), folder=folder, **arguments)


def kill_in_stretch(stretch: int) -> None:
    """Let this process be killed, as by kill -9, when it examines the policy of that stretch."""
    examined = []
    fly = Examiner.__call__

    def fly_or_die(self, policy):
        examined.append(policy)
        if len(examined) == stretch:
            os.kill(os.getpid(), signal.SIGKILL)
        return fly(self, policy)

    Examiner.__call__ = fly_or_die


if __name__ == "__main__":
    kill_in_stretch(int(sys.argv[3]))
    train_tiny(Path(sys.argv[1]), total_frames=int(sys.argv[2]))
