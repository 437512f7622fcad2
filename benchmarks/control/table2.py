"""The paper's Table 2 with three training seeds, more scenarios and more boxes.

python -m benchmarks.control.table2 [POLICIES]
"""

import argparse
import sys
from pathlib import Path

import torch
from hydra import compose, initialize_config_dir

from auv_torchrl.experiment import schema
from auv_torchrl.experiment.console import Stages
from auv_torchrl.experiment.results import Results
from auv_torchrl.experiment.run import perform
from auv_torchrl.experiment.setup import read_experiment
from auv_torchrl.experiment.summary import picture, table
from auv_torchrl.paths import CONF, PROJECT
from benchmarks.control.source import STORE

SEEDS = (0, 1, 2)
SCENARIOS = ("swap", "thruster_gain", "reversed", "reversed_and_dead", "cycle", "all_reversed")
CASES = [("paper", 1.0, name) for name in SCENARIOS] + [("paper", 2.0, name) for name in SCENARIOS]
CASES += [("bluerov2", 10.0, "reversed_and_dead")]
NEAR_M = 2.0  # the paper vehicle needs longer than 10 s from farther away, so nothing farther chooses its best policy
PICTURE = PROJECT / "docs" / "results" / "table2.png"


def measure(vehicle: str, box_m: float, scenario: str, seed: int, policies: Path) -> Results:
    """One run with the defaults of conf/train.yaml, without figures and recording."""
    overrides = [
        f"+scenario={scenario}",
        f"vehicle={vehicle}",
        f"box_m={box_m}",
        f"agent.evaluation_box_m={max(NEAR_M, box_m)}",
        f"seed={seed}",
        f"policies={policies}",
        "flight.fly=false",  # fault_recovery measures that
    ]
    with initialize_config_dir(version_base="1.3", config_dir=str(CONF)):
        config = compose("train", overrides)
    return perform(read_experiment(config, scenario), Stages(5)).results


def training_times(runs: list[Results]) -> str:
    """One line per vehicle: wall time of the training of each seed."""
    times = {(run.vehicle, run.seed): run.train_s for run in runs}
    lines = []
    for vehicle in dict.fromkeys(vehicle for vehicle, _ in times):
        listed = ", ".join(f"{seconds:.0f} s" for (name, _), seconds in times.items() if name == vehicle)
        lines.append(f"Training of the source policies, vehicle {vehicle}: {listed}.")
    return "\n".join(lines)


def main() -> None:
    """Measure every case and print Markdown."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("policies", type=Path, nargs="?", default=STORE, help="folder of trained policies")
    policies = parser.parse_args().policies
    torch.set_num_threads(1)
    schema.register()
    runs = []
    for vehicle, box_m, scenario in CASES:
        for seed in SEEDS:
            run = measure(vehicle, box_m, scenario, seed, policies)
            runs.append(run)
            error = f"{run.u_t.mean_m:.4f} m, worst {run.u_t.worst_m:.4f} m" if run.u_t else run.reason
            print(f"{scenario}, {vehicle}, ±{box_m:g} m, seed {seed}: u_t {error}", file=sys.stderr, flush=True)
    rows = [run.as_dict() for run in runs]
    picture(rows).savefig(PICTURE, dpi=120)
    print(table(rows))
    print()
    print(training_times(runs))
    print()
    print("![every run](table2.png)")


if __name__ == "__main__":
    main()
