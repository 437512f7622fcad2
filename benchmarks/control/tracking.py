"""Paths flown by one policy and by the PID, in still water and with a thruster reversed.

python -m benchmarks.control.tracking [--count N] [--curves NAME ...]
"""

import argparse
from dataclasses import replace
from pathlib import Path

import torch
from torchrl.envs import TransformedEnv

from auv_torchrl.adaptation import InFlightAdapter, load_adaptation_config
from auv_torchrl.agents.config import load_agent_config
from auv_torchrl.agents.pid import PID
from auv_torchrl.agents.train_source import train_source
from auv_torchrl.ddr import AdapterConfig, DDRAdapter, adapt
from auv_torchrl.ddr.store import load_or_pretrain
from auv_torchrl.ddr.transform import observing
from auv_torchrl.envs import FleetEnv, make_fleet
from auv_torchrl.evaluation import Metrics, Policy, draw_starts, fly
from auv_torchrl.scenario import Scenario
from auv_torchrl.tasks import TASKS, Lemniscate, Task, Tracking
from auv_torchrl.vehicle import Vehicle, load_vehicle
from benchmarks.control.methods import INTEGRAL
from benchmarks.control.source import BACKEND, STORE, ranges, shipped_scenario, training_s

CURVES = tuple(name for name, kind in TASKS.items() if issubclass(kind, Tracking))
BOX_M = 1.0  # m, starts lie within it around the beginning of the path
SEED = 2023  # of the starts


class Course:
    """One path and everything that flies it, from the same starts."""

    def __init__(self, vehicle: Vehicle, task: Task, count: int):
        self.vehicle, self.count = vehicle, count
        self.task = task.for_evaluation(BOX_M)
        self.starts = draw_starts(self.task, count, SEED)

    def fleet(self, scenario: Scenario | None, count: int, thruster_commands: bool = False) -> FleetEnv:
        """Vehicles with the changes of a scenario."""
        task = replace(self.task, thruster_commands=thruster_commands)
        return make_fleet(BACKEND, self.vehicle, task, count, scenario=scenario, seed=0)

    def fly(self, policy: Policy, scenario: Scenario | None = None) -> Metrics:
        """As it is."""
        return Metrics.of(fly(self.fleet(scenario, self.count), policy, self.starts, self.task.steps))

    def mapped(self, policy: Policy, scenario: Scenario, policies: Path) -> Metrics:
        """Behind DDR's map, from 4 s of target data."""
        models, config = load_or_pretrain(self.vehicle, self.task, policies), AdapterConfig()
        fitted = adapt(lambda count: self.fleet(scenario, count), policy, models, config).adapter  # type: ignore[arg-type]
        adapter = DDRAdapter(models, config)
        adapter.load_state_dict(fitted.state_dict())
        target = TransformedEnv(self.fleet(scenario, self.count), adapter)
        return Metrics.of(fly(target, policy, self.starts, self.task.steps))

    def adapting(self, policy: Policy, scenario: Scenario) -> Metrics:
        """With the adaptation in flight, from the first moment on."""
        task = replace(self.task, thruster_commands=True)
        adapter = InFlightAdapter(self.vehicle, task, load_adaptation_config(), self.count)
        target = TransformedEnv(self.fleet(scenario, self.count, True), observing(adapter, task))
        return Metrics.of(fly(target, policy, self.starts, self.task.steps))


def row(course: Course, policy: Policy, scenario: Scenario, policies: Path) -> str:
    """One line of the table."""
    task, vehicle = course.task, course.vehicle
    forward = PID(task, integral=INTEGRAL, vehicle=vehicle)
    flown = [
        course.fly(PID(task, integral=INTEGRAL)),
        course.fly(forward),
        course.fly(policy),
        course.fly(forward, scenario),
        course.fly(policy, scenario),
        course.mapped(policy, scenario, policies),
        course.adapting(policy, scenario),
    ]
    still = flown[2]
    cells = [f"{metrics.mean_m:.4f}" for metrics in flown]
    return f"| {task.name} | {' | '.join(cells)} | {still.p95_m:.4f} | {still.heading_rad:.3f} |"


def main() -> None:
    """Train on the lemniscate, or take what was trained before, fly every path, and print Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=50, help="starts per path and controller")
    parser.add_argument("--curves", nargs="+", default=CURVES, choices=CURVES, metavar="NAME")
    parser.add_argument("--policies", type=Path, default=STORE, help="store of policies")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    vehicle, trained_on = load_vehicle("paper"), Lemniscate()
    agent = load_agent_config()
    source = train_source(vehicle, trained_on, agent, ranges("paper"), 0, BACKEND, arguments.policies)
    reversed_, took = shipped_scenario("reversed", vehicle), training_s(source)
    print(
        f"Mean distance to the moving reference in m for t ≥ 10 s of 20 s, {arguments.count} starts in ±{BOX_M:g} m, "
        f"vehicle paper, every path at the settings of its file (lemniscate: 2 m × 1 m at 0.3 m/s). One policy, u_s, "
        f"trained on the lemniscate with the default budget ({took:.0f} CPU s), flies all of them; PID: gains of the "
        f"station keeping and an integral, feed-forward from the vehicle's own file.\n"
    )
    print(
        "| path | still water: PID | PID with feed-forward | u_s | thruster 1 reversed: PID with feed-forward | u_s | "
        "u_s, DDR from 4 s | u_s, adapting in flight | u_s in still water: 95 % of the starts below | heading [rad] |"
    )
    print("|---|" + "---:|" * 9)
    for name in arguments.curves:
        course = Course(vehicle, TASKS[name](), arguments.count)  # type: ignore[arg-type]
        print(row(course, source.module, reversed_, arguments.policies), flush=True)


if __name__ == "__main__":
    main()
