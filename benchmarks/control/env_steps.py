"""Control steps per CPU second of the fleets on one thread, whole episodes with randomization, reward and reset.

python -m benchmarks.control.env_steps [--sizes 1 64 256 1024] [--vehicle paper] [--randomization paper]
"""

import argparse
import statistics
import time

import torch
from tensordict import TensorDictBase
from torchrl.envs import EnvBase, TransformedEnv

from auv_torchrl.envs import MujocoFleet, RandomizeVehicle, TorchFleet
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import Vehicle, load_vehicle
from benchmarks.control.source import ranges

SIZES = [1, 64, 256, 1024]  # vehicles of a fleet
REPEATS = 3  # the median is reported, since other programs disturb


def fleets(vehicle: Vehicle, count: int) -> dict[str, EnvBase]:
    """The environments that are compared, by the head of their column."""
    task = StationKeeping()
    built: dict[str, EnvBase] = {
        "MuJoCo": MujocoFleet(vehicle, task, count, seed=0),
        "torch": TorchFleet(vehicle, task, count, seed=0),
        "torch, compiled": TorchFleet(vehicle, task, count, seed=0, compiled=True),
    }
    if torch.cuda.is_available():
        built["torch, compiled, cuda"] = TorchFleet(vehicle, task, count, seed=0, device="cuda", compiled=True)
    return built


def steps_per_second(env: EnvBase, wall: bool) -> float:
    """Control steps of all vehicles per second over one episode with its reset, actions drawn beforehand."""
    clock = time.perf_counter if wall else time.process_time
    actions = env.action_spec.rand()
    episode = 400

    def fly(now: TensorDictBase, steps: int) -> TensorDictBase:
        for _ in range(steps):
            _, now = env.step_and_maybe_reset(now.set("action", actions))
        return now

    rates = []
    now = fly(env.reset(), 10)
    for _ in range(REPEATS):
        begin = clock()
        now = fly(now, episode)
        if wall:
            torch.cuda.synchronize()
        rates.append(env.batch_size[0] * episode / (clock() - begin))
    return statistics.median(rates)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES, help="numbers of vehicles")
    parser.add_argument("--vehicle", default="paper", help="name in conf/vehicle")
    parser.add_argument("--randomization", default="paper", help="name in conf/randomization")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    vehicle = load_vehicle(arguments.vehicle)
    drawn = ranges(arguments.randomization)
    print(
        f"Thousands of control steps of 0.05 s per CPU second on one thread (wall time on a GPU), vehicle "
        f"{arguments.vehicle}, randomization {arguments.randomization}, observation, reward and reset included.\n"
    )
    for row, count in enumerate(arguments.sizes):
        columns = fleets(vehicle, count)
        if row == 0:
            print("| vehicles | " + " | ".join(columns) + " |")
            print("|---" * (len(columns) + 1) + "|")
        rates = [
            steps_per_second(TransformedEnv(env, RandomizeVehicle(vehicle, drawn)), wall=env.device.type == "cuda")
            for env in columns.values()
        ]
        print(f"| {count} | " + " | ".join(f"{rate / 1e3:.1f}" for rate in rates) + " |")


if __name__ == "__main__":
    main()
