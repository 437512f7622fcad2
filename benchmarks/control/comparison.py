"""Every method on every scenario, from the same starts: python -m benchmarks.control.comparison [--scenarios NAME ...].

What has been flown lies in outputs/comparison and is not flown again by the same code, so that a killed run goes on;
--fresh flies all again. The methods: methods.py; tables and picture: comparison_tables.py.
"""

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path

import torch

from auv_torchrl.evaluation import Metrics
from auv_torchrl.files import write_whole
from auv_torchrl.paths import PROJECT
from auv_torchrl.scenario import Scenario, scenarios_of
from auv_torchrl.vehicle import load_vehicle
from benchmarks import provenance
from benchmarks.control.comparison_tables import Cell, draw, report
from benchmarks.control.methods import METHODS, Bench
from benchmarks.control.source import STORE, ranges, shipped_scenario, source_policy

CELLS = PROJECT / "outputs" / "comparison"
PICTURE = PROJECT / "docs" / "results" / "comparison.png"


def cell(bench: Bench, method: str, folder: Path, fresh: bool) -> Cell:
    """What a method did in a scenario, flown now or before by the same code with the same starts and source policy."""
    changes = repr([(c.effect.name, c.values, c.start_s, c.stop_s) for c in bench.scenario.changes])
    policy, code = bench.source.metadata["hash"], provenance.digest()
    key = {"code": code, "policy": policy, "starts": bench.count, "scenario": changes}
    path = folder / bench.scenario.name / f"{method.replace(',', '').replace(' ', '_')}.json"
    if path.exists() and not fresh:
        kept = json.loads(path.read_text())
        if kept.pop("key") == key:
            return Cell(**kept)
    torch.manual_seed(0)
    attempt = METHODS[method](bench)
    judged = Metrics.of(attempt.flight)
    made = Cell(judged.mean_m, judged.p95_m, judged.worst_m, attempt.target_data_s, attempt.compute_s, attempt.notes)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, (json.dumps({"key": key, **made._asdict()}, indent=2) + "\n").encode())
    print(f"{method}: {bench.scenario.name}: {made.mean_m:.4f} m", file=sys.stderr, flush=True)
    return made


def main() -> None:
    """Fly what has not been flown, print Markdown, draw the picture."""
    names = scenarios_of(load_vehicle("paper"))
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenarios", nargs="+", default=names, choices=names, help="default: all", metavar="NAME")
    parser.add_argument("--methods", nargs="+", default=list(METHODS), choices=list(METHODS), metavar="METHOD")
    parser.add_argument("--count", type=int, default=50, help="starts per scenario")
    parser.add_argument("--fresh", action="store_true", help="fly again what was flown before")
    parser.add_argument("--policies", type=Path, default=STORE, help="store of policies")
    parser.add_argument("--cells", type=Path, default=CELLS, help="where single results are kept")
    parser.add_argument("--picture", type=Path, default=PICTURE)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    vehicle = load_vehicle("paper")
    source = source_policy(vehicle, arguments.policies, ranges("paper"))
    blank = Bench(vehicle, Scenario("nominal"), arguments.policies, arguments.count, source)
    nominal = Metrics.of(blank.fly(source.module)).mean_m
    table: dict[str, dict[str, Cell]] = {}
    for method in arguments.methods:
        table[method] = {}
        for name in arguments.scenarios:
            bench = replace(blank, scenario=shipped_scenario(name, vehicle))
            table[method][name] = cell(bench, method, arguments.cells, arguments.fresh)
    print(report(table, arguments.count, nominal))
    draw(table, arguments.picture)
    print(f"\n![every method in every scenario]({arguments.picture.name})")


if __name__ == "__main__":
    main()
