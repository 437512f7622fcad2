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
FLEETS = ("MujocoFleet-64", "MujocoFleet-256", "TorchFleet-64", "TorchFleet-1024")  # class and vehicles
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
for fleet in sys.argv[1:]:
    kind, count = fleet.split("-")
    made = getattr(envs, kind)(vehicle, StationKeeping(), int(count), seed=0)
    print(steps_per_second(TransformedEnv(made, envs.RandomizeVehicle(vehicle, ranges)), wall=False))
"""  # of either version, by what both have


def rates(folder: Path) -> list[float]:
    """Control steps per CPU second of each fleet of the version in a folder, measured in a process of its own."""
    command = [sys.executable, "-W", "ignore", "-c", MEASURED, *FLEETS]
    environment = {**os.environ, "PYTHONPATH": str(folder), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=True)
    return [float(line) for line in done.stdout.split()]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="checkout of the other version")
    parser.add_argument("--rounds", type=int, default=5, help="how often both are measured")
    arguments = parser.parse_args()
    pairs = [(rates(arguments.folder.resolve()), rates(HERE)) for _ in range(arguments.rounds)]
    print("Thousands of control steps per CPU second on one thread, medians; ratios are those of each round.\n")
    print("| fleet-vehicles | before | now | times, median | least | most |\n|---|---|---|---|---|---|")
    for place, fleet in enumerate(FLEETS):
        before, now = ([rates[place] / 1e3 for rates in version] for version in zip(*pairs, strict=True))
        ratios = [later / earlier for earlier, later in zip(before, now, strict=True)]
        figures = " | ".join(f"{figure:.2f}" for figure in (statistics.median(ratios), min(ratios), max(ratios)))
        print(f"| {fleet} | {statistics.median(before):.1f} | {statistics.median(now):.1f} | {figures} |")


if __name__ == "__main__":
    main()
