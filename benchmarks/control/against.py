"""Control steps per CPU second of this version against another one, in turn, so that load strikes both alike.

python -m benchmarks.control.against FOLDER [--rounds 5]

FOLDER is a checkout of the other version: git worktree add FOLDER COMMIT
"""

import argparse
import os
import statistics
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parents[2]
FLEETS = (("MujocoFleet", 64), ("MujocoFleet", 256), ("TorchFleet", 64), ("TorchFleet", 1024))
MEASURED = """
import sys, torch, yaml
from torchrl.envs import TransformedEnv
from auv_torchrl import envs
from auv_torchrl.paths import config_path
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import load_vehicle
from benchmarks.control.env_steps import steps_per_second
torch.set_num_threads(1)
vehicle = load_vehicle("paper")
ranges = yaml.safe_load(config_path("randomization", "paper").read_text())
fleet = getattr(envs, sys.argv[1])(vehicle, StationKeeping(), int(sys.argv[2]), seed=0)
print(steps_per_second(TransformedEnv(fleet, envs.RandomizeVehicle(vehicle, ranges)), wall=False))
"""  # of either version, by what both have


def rate(folder: Path, kind: str, count: int) -> float:
    """Control steps per CPU second of a fleet of the version in a folder, measured in a process of its own."""
    command = [sys.executable, "-W", "ignore", "-c", MEASURED, kind, str(count)]
    environment = {**os.environ, "PYTHONPATH": str(folder), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=True)
    return float(done.stdout)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="checkout of the other version")
    parser.add_argument("--rounds", type=int, default=5, help="how often both are measured")
    arguments = parser.parse_args()
    print(
        "Thousands of control steps per CPU second on one thread, medians; the ratio is that of each round, median.\n"
    )
    print("| fleet | vehicles | before | now | times | least | most |\n|---|---|---|---|---|---|---|")
    for kind, count in FLEETS:
        pairs = [
            (rate(arguments.folder.resolve(), kind, count), rate(HERE, kind, count)) for _ in range(arguments.rounds)
        ]
        before, now = (statistics.median(rates) / 1e3 for rates in zip(*pairs, strict=True))
        ratios = [later / earlier for earlier, later in pairs]
        figures = " | ".join(f"{figure:.2f}" for figure in (statistics.median(ratios), min(ratios), max(ratios)))
        print(f"| {kind} | {count} | {before:.1f} | {now:.1f} | {figures} |", flush=True)


if __name__ == "__main__":
    main()
