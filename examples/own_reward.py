"""A reward of one's own: a vehicle that is to hold its place, and pays for thrust.

python examples/own_reward.py [TRANSITIONS] [VEHICLES]

As a file of lab/tasks/, with ``TASKS = (Thrifty,)`` at its end and its settings in lab/task/thrifty.yaml, the task is
flown by ``python train.py --config-dir lab task=thrifty`` too (docs/how-to/add-an-agent-or-task.md).
"""

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from auv_torchrl.agents.config import load_agent_config
from auv_torchrl.agents.train_source import train_source
from auv_torchrl.envs import make_fleet
from auv_torchrl.evaluation import Metrics, draw_starts, fly
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import load_vehicle


@dataclass(frozen=True)
class Thrifty(StationKeeping):
    """Station keeping that also pays for the square of each command."""

    name = "thrifty"
    price: float = 0.05  # of a full command in one channel; a metre away from the target costs 1

    def reward(self, position: Any, quaternion: Any, velocity: Any, action: Any, time: Any) -> Any:
        """Reward (N,) of the true state that actions (N, 4) have led to; arrays of numpy or torch."""
        usual = super().reward(position, quaternion, velocity, action, time)
        return usual - self.price * (action**2).sum(-1)


def main(transitions: int = 51200, vehicles: int = 64) -> float:
    """Train with both rewards; returns the mean distance in m to the target for t >= 10 s of the thrifty one."""
    torch.set_num_threads(1)  # networks this small gain nothing from more
    vehicle, distance = load_vehicle("paper"), 0.0
    agent = load_agent_config("sac", {"total_frames": transitions, "num_envs": vehicles})
    for task in (StationKeeping(), Thrifty()):
        with tempfile.TemporaryDirectory() as store:
            policy = train_source(vehicle, task, agent, None, seed=0, backend="mujoco", folder=Path(store))
        exam = task.for_evaluation(box_m=1.0)
        flight = fly(make_fleet("mujoco", vehicle, exam, 50), policy.module, draw_starts(exam, 50, seed=1), exam.steps)
        distance, effort = Metrics.of(flight).mean_m, float(flight.action[:, 1:].square().sum(-1).mean())
        print(f"{task.name}: {distance:.4f} m from the target, mean square of the commands {effort:.4f}")
    return distance


if __name__ == "__main__":
    print(f"mean distance to the target: {main(*map(int, sys.argv[1:])):.4f} m")
