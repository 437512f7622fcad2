"""What a GPU does: control steps per second of large fleets, and trainings of which all is on the device.

    python -m benchmarks.control.on_gpu [--device cuda] [--sizes 1024 16384 65536] [--seeds 1]

A fleet flies whole episodes under random actions, with observation, reward and reset; its physics is compiled by
torch. A training ends where the mean error from 64 fixed starts is below 0.02 m. Wall time counts, behind a
synchronization of the device. Prints Markdown, and writes nothing; `make gpu` runs the tests of a GPU before.
"""

import argparse
import statistics
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import torch
from tensordict import TensorDictBase
from torchrl.envs import TransformedEnv

from auv_torchrl.agents.config import load_agent_config
from auv_torchrl.agents.train_source import make_trainer
from auv_torchrl.envs import RandomizeVehicle, TorchFleet
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import load_vehicle
from benchmarks.control.source import ranges
from benchmarks.control.time_to_error import GOALS_M, first_below

SIZES = (1024, 16_384, 65_536)  # vehicles of a fleet; the last is what GPU simulators quote
AGENTS = ("gradient", "ppo")  # which learn from fleets of this size
EPISODE = 400  # control steps: each vehicle is reset once
WARM_UP = 10  # steps that compile
REPEATS = 3  # the median is reported
MUST_STEPS, MUST_S = 20e6, 5.0  # control steps per second at the largest size; s of a training


def synchronize(device: torch.device) -> None:
    """Wait until the device has done what it was given."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)


def steps_per_second(count: int, device: torch.device, steps: int = EPISODE, compiled: bool = True) -> float:
    """Control steps of all vehicles per second of wall time."""
    vehicle = load_vehicle("paper")
    fleet = TorchFleet(vehicle, StationKeeping(), count, seed=0, device=device, compiled=compiled)
    env = TransformedEnv(fleet, RandomizeVehicle(vehicle, ranges("paper"), seed=0))
    actions = env.action_spec.rand()

    def fly(now: TensorDictBase, steps: int) -> TensorDictBase:
        for _ in range(steps):
            _, now = env.step_and_maybe_reset(now.set("action", actions))
        synchronize(device)
        return now

    now, rates = fly(env.reset(), WARM_UP), []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        now = fly(now, steps)
        rates.append(count * steps / (time.perf_counter() - begin))
    return statistics.median(rates)


def seconds_of_training(agent: str, seed: int, device: torch.device, **changes: Any) -> tuple[float, float]:
    """Wall seconds until the last goal, infinite where it is not reached, and the error in m at the end.

    ``changes`` are settings of the agent.
    """
    config = load_agent_config(agent, {"stop_below_m": min(GOALS_M), **changes})
    vehicle = load_vehicle("paper")
    with tempfile.TemporaryDirectory() as folder:
        task, drawn = StationKeeping(box_m=1.0), ranges("paper")
        trainer = make_trainer(vehicle, task, config, drawn, seed, "torch", Path(folder), "gpu", device)
        trainer.run()
    curve = [(point["cpu_s"], point["wall_s"], point["error_m"]) for point in trainer.curve]
    return first_below(curve, min(GOALS_M))[1], curve[-1][2]


def table(device: torch.device, sizes: tuple[int, ...], seeds: int) -> Iterator[str]:
    """Lines of Markdown, each as soon as it is measured."""
    name = torch.cuda.get_device_name(device) if device.type == "cuda" else "the CPU, on one thread"
    yield f"On {name}, torch {torch.__version__}, vehicle paper, randomization paper.\n"
    yield f"| vehicles | million control steps/s (must {MUST_STEPS / 1e6:.0f} for the most) |"
    yield "|---|---|"
    for count in sizes:
        yield f"| {count:,} | {steps_per_second(count, device) / 1e6:.2f} |"
    yield f"\n| agent | seed | s until {min(GOALS_M):g} m (must {MUST_S:g}) | error at the end, cm |"
    yield "|---|---|---|---|"
    for agent in AGENTS:
        for seed in range(seeds):
            seconds, error = seconds_of_training(agent, seed, device)
            yield f"| {agent} | {seed} | {seconds:.1f} | {100 * error:.1f} |"


def main() -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda", help="cuda, cuda:1, or cpu to see that all of this runs")
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES, help="numbers of vehicles")
    parser.add_argument("--seeds", type=int, default=1, help="trainings of each agent")
    arguments = parser.parse_args()
    device = torch.device(arguments.device)
    if device.type == "cuda" and not torch.cuda.is_available():
        parser.error(
            "torch finds no CUDA device: give --device cpu, or install torch with CUDA on a machine with a GPU"
        )
    torch.set_num_threads(1)
    warnings.filterwarnings("ignore", "Dynamo detected", UserWarning)  # of array-api-compat's caches, which hold types
    for line in table(device, tuple(arguments.sizes), arguments.seeds):
        print(line, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
