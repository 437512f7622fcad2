"""Every agent in every scenario, on tasks of each kind: alone, behind DDR's map, and adapting in flight.

    python -m benchmarks.control.tasks [--tasks NAME ...] [--agents NAME ...] [--scenarios NAME ...]

Each agent is trained on each task as ``train.py`` does. What has been flown lies in outputs/tasks and is not flown
again.
"""

import argparse
import json
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from tqdm import tqdm

from auv_torchrl.agents.config import AGENTS, load_agent_config
from auv_torchrl.agents.policy import SourcePolicy
from auv_torchrl.agents.train_source import train_source
from auv_torchrl.files import write_whole
from auv_torchrl.paths import PROJECT, config_names
from auv_torchrl.scenario import Scenario, scenarios_of
from auv_torchrl.tasks import read_task
from auv_torchrl.vehicle import load_vehicle
from benchmarks import provenance
from benchmarks.control.comparison_tables import RECOVERED_M, metres
from benchmarks.control.source import BACKEND, STORE, ranges, shipped_scenario, training_s
from benchmarks.control.tracking import BOX_M, Course

KINDS = ("station_keeping", "waypoints", "lemniscate")  # a point, one after the other, a moving one
WAYS = ("alone", "DDR from 4 s", "in flight")
CELLS = PROJECT / "outputs" / "tasks"

Means = Mapping[str, float]  # way -> mean error for t >= 10 s, m


def flown(course: Course, source: SourcePolicy, scenario: Scenario | None, cells: Path, policies: Path) -> Means:
    """What a policy holds in a scenario, each way; flown now, or before by the same code from the same starts."""
    changes = [(c.effect.name, c.values, c.start_s, c.stop_s) for c in scenario.changes] if scenario else []
    key = {
        "code": provenance.digest(), "policy": source.metadata["hash"], "starts": course.count,
        "scenario": repr(changes),
    }  # fmt: skip
    path = cells / source.metadata["hash"] / f"{scenario.name if scenario else 'nominal'}.json"
    if path.exists() and (kept := json.loads(path.read_text()))["key"] == key:
        return kept["means"]
    torch.manual_seed(0)
    means = {WAYS[0]: course.fly(source.module, scenario).mean_m}
    if scenario:
        means[WAYS[1]] = course.mapped(source.module, scenario, policies).mean_m
        means[WAYS[2]] = course.adapting(source.module, scenario).mean_m
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, json.dumps({"key": key, "means": means}, indent=2).encode())
    return means


def summary(task: str, agent: str, source: SourcePolicy, nominal: Means, found: Mapping[str, Means]) -> str:
    """One line of the first table: an agent on a task, over all scenarios."""
    cells = [task, agent, f"{training_s(source):.0f}", metres(nominal[WAYS[0]])]
    near = nominal[WAYS[0]] < RECOVERED_M  # on the way to a waypoint even a sound vehicle is not
    for way in WAYS:
        errors = [means[way] for means in found.values()]
        recovered = f"{sum(e < RECOVERED_M for e in errors)} of {len(errors)}" if near else "–"
        cells += [metres(float(np.median(errors))), recovered]
    return f"| {' | '.join(cells)} |"


def by_scenario(agents: Mapping[str, Mapping[str, Means]]) -> str:
    """One row for each scenario, one column for each agent, behind DDR's map and in flight."""
    head = "".join(f" {agent}: {way} |" for agent in agents for way in WAYS[1:])
    rows = [f"| scenario |{head}", "|---|" + "---:|" * (2 * len(agents))]
    for scenario in next(iter(agents.values())):
        errors = "".join(f" {metres(found[scenario][way])} |" for found in agents.values() for way in WAYS[1:])
        rows.append(f"| {scenario} |{errors}")
    return "\n".join(rows)


def main() -> None:
    """Train what has not been trained, fly what has not been flown, print Markdown."""
    names = scenarios_of(load_vehicle("paper"))
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tasks", nargs="+", default=KINDS, choices=config_names("task"), metavar="NAME")
    parser.add_argument("--agents", nargs="+", default=list(AGENTS), choices=list(AGENTS), metavar="NAME")
    parser.add_argument("--scenarios", nargs="+", default=names, choices=names, metavar="NAME", help="default: all")
    parser.add_argument("--count", type=int, default=20, help="starts per scenario")
    parser.add_argument("--policies", type=Path, default=STORE, help="store of policies")
    parser.add_argument("--cells", type=Path, default=CELLS, help="where single results are kept")
    asked = parser.parse_args()
    torch.set_num_threads(1)
    vehicle, seed = load_vehicle("paper"), 0
    scenarios = {name: shipped_scenario(name, vehicle) for name in asked.scenarios}
    lines, tables = [], []
    for kind in asked.tasks:
        task, agents = read_task({"name": kind}), {}
        course = Course(vehicle, task, asked.count)
        for agent in asked.agents:
            config = load_agent_config(agent)
            source = train_source(vehicle, task, config, ranges("paper"), seed, BACKEND, asked.policies)
            nominal = flown(course, source, None, asked.cells, asked.policies)
            agents[agent] = {
                name: flown(course, source, scenario, asked.cells, asked.policies)
                for name, scenario in tqdm(scenarios.items(), desc=f"{kind}, {agent}", unit="scenario", disable=None)
            }
            lines.append(summary(kind, agent, source, nominal, agents[agent]))
            print(lines[-1], file=sys.stderr, flush=True)
        tables.append(f"{kind}, by scenario, m:\n\n{by_scenario(agents)}")
    print(
        f"{asked.count} starts in ±{BOX_M:g} m, vehicle `paper` in MuJoCo, 20 s, mean distance to the reference for "
        f"t ≥ 10 s, seed {seed}; the median of the scenarios, and in how many it is below {RECOVERED_M} m. "
        "The reference of `waypoints` is the next point, so that less means sooner there, and not closer. "
        "Each agent is trained on each task over `conf/randomization/paper.yaml` with its default budget.\n"
    )
    ways = "".join(f" {way}: median [m] | recovered |" for way in WAYS)
    print(f"| task | agent | training, CPU s | nominal [m] |{ways}\n|---|---|" + "---:|" * (2 + 2 * len(WAYS)))
    print("\n".join([*lines, *("\n" + table for table in tables)]))


if __name__ == "__main__":
    main()
