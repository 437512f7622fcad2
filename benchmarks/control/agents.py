"""What each agent costs and how well its policy flies: trained as ``train.py`` does, from 100 starts, in MuJoCo.

    python -m benchmarks.control.agents [--seeds 1] [--store DIR]

A policy that the store has already costs nothing here: its training time is that of when it was trained.
"""

import argparse
from pathlib import Path

import torch

from auv_torchrl.agents.config import AGENTS, load_agent_config
from auv_torchrl.agents.policy import SourcePolicy
from auv_torchrl.agents.train_source import train_source
from auv_torchrl.envs import make_fleet
from auv_torchrl.evaluation import Metrics, draw_starts, fly
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import Vehicle, load_vehicle
from benchmarks.control.source import BACKEND, STORE, ranges, shipped_scenario

SCENARIOS = ("pose_delay", "command_delay", "thruster_lag", "current", "payload", "drag", "sensor_noise")
SEEDS = 1
STARTS, STARTS_SEED, BOX_M = 100, 2023, 1.0  # those of train.py


def flown(policy: SourcePolicy, vehicle: Vehicle, name: str | None) -> Metrics:
    """How the policy flies the vehicle in a scenario, None for none, without adaptation."""
    exam = StationKeeping().for_evaluation(BOX_M)
    scenario = None if name is None else shipped_scenario(name, vehicle)
    fleet = make_fleet(BACKEND, vehicle, exam, STARTS, scenario=scenario, seed=0)
    return Metrics.of(fly(fleet, policy.module, draw_starts(exam, STARTS, STARTS_SEED), exam.steps))


def row(agent: str, seed: int, store: Path) -> str:
    """One line of the table."""
    vehicle = load_vehicle("paper")
    policy = train_source(vehicle, StationKeeping(), load_agent_config(agent), ranges("paper"), seed, BACKEND, store)
    last, nominal = policy.metadata["curve"][-1], flown(policy, vehicle, None)
    errors = [f"{flown(policy, vehicle, name).mean_m:.4f}" for name in SCENARIOS]
    numbers = [f"{last['cpu_s']:.0f}", f"{last['wall_s']:.0f}", f"{nominal.mean_m:.4f}", f"{nominal.worst_m:.4f}"]
    return " | ".join(["", agent, str(seed), *numbers, *errors, ""]).strip()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--store", type=Path, default=STORE)
    parser.add_argument("--agents", nargs="+", default=list(AGENTS))
    options = parser.parse_args()
    torch.set_num_threads(1)
    heads = ["agent", "seed", "CPU s", "wall s", "nominal [m]", "worst start [m]", *SCENARIOS]
    print(
        f"Vehicle paper, {STARTS} starts within ±{BOX_M:g} m, mean error for t >= 10 s; scenarios without adaptation. "
        "Times of a whole training, examinations included.\n"
    )
    print(f"| {' | '.join(heads)} |\n{'|---' * len(heads)}|")
    for seed in range(options.seeds):
        for agent in options.agents:
            print(row(agent, seed, options.store), flush=True)
