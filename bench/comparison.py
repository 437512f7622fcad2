"""Every method on every scenario, from the same starts: python -m bench.comparison [--train] [--scenarios NAME ...].

Methods that train a policy for each scenario (particle weights, the oracle) and the robust policy take minutes each:
they run with --train.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import torch
import yaml
from torchrl.envs import TransformedEnv

from auv_torchrl.agents.config import load_agent_config
from auv_torchrl.agents.pid import PID
from auv_torchrl.agents.train_source import train_source
from auv_torchrl.baselines import FixedSigns, RecursiveLeastSquares, TrueMap, pulse_test, weigh_particles
from auv_torchrl.ddr import AdapterConfig, DDRAdapter, adapt
from auv_torchrl.ddr.store import load_or_pretrain
from auv_torchrl.envs import RegulationTask, TorchFleet
from auv_torchrl.evaluation import Flight, Metrics, draw_starts, fly
from auv_torchrl.online import OnlineAdapter, load_online_config
from auv_torchrl.paths import PROJECT, config_names, config_path
from auv_torchrl.scenario import Scenario, read_scenario
from auv_torchrl.vehicle import Vehicle, load_vehicle

BUDGET_S = 4.0  # of target data before the judged flight, for methods that collect any
INTEGRAL = (0.5, 0.5, 0.5, 0.2)  # 1/(m s) and 1/(rad s)
PICTURE = PROJECT / "docs" / "comparison.png"


@dataclass(frozen=True)
class Attempt:
    """What a method did in a scenario."""

    flight: Flight
    target_data_s: float  # flown on the target before the judged flight
    compute_s: float  # CPU time before the judged flight


@dataclass(frozen=True)
class Bench:
    """One scenario with everything that methods need; they all fly the same starts."""

    vehicle: Vehicle
    scenario: Scenario
    policies: Path
    count: int
    policy: Any  # u_s

    @property
    def target(self) -> Vehicle:
        """The vehicle when every effect has begun, no batch."""
        return self.scenario.vehicle_at(self.vehicle, max((c.start_s for c in self.scenario.changes), default=0.0))

    def task(self, thruster_commands: bool = False) -> RegulationTask:
        """The judged task: 20 s from starts in ±1 m."""
        return replace(RegulationTask().for_evaluation(1.0), thruster_commands=thruster_commands)

    def fleet(self, count: int, thruster_commands: bool = False) -> TorchFleet:
        """Target vehicles."""
        return TorchFleet(self.vehicle, self.task(thruster_commands), count, scenario=self.scenario, seed=0)

    def fly(self, policy: Any, transform: Any = None, thruster_commands: bool = False) -> Flight:
        """The judged flight."""
        fleet: Any = self.fleet(self.count, thruster_commands)
        if transform is not None:
            fleet = TransformedEnv(fleet, transform)
        task = self.task()
        return fly(fleet, policy, draw_starts(task, self.count, seed=2023), task.steps)

    def train(self, vehicle: Vehicle, randomization: dict[str, Any]) -> Any:
        """A policy trained on this vehicle, from the store if it was trained before."""
        task = RegulationTask()
        return train_source(vehicle, task, load_agent_config(), randomization, 0, "mujoco", self.policies).module


def ddr(bench: Bench, kind: str) -> Attempt:
    """The paper's method: seconds of target data with dither, then a fitted map."""
    models = load_or_pretrain(bench.vehicle, bench.task(), bench.policies)
    config = AdapterConfig(map=kind, target_data_s=BUDGET_S)
    thrusters = kind == "thrusters"
    began = time.process_time()
    fitted = adapt(lambda count: bench.fleet(count, thrusters), bench.policy, models, config).adapter
    spent = time.process_time() - began
    adapter = DDRAdapter(models, config)
    adapter.load_state_dict(fitted.state_dict())
    return Attempt(bench.fly(bench.policy, adapter, thrusters), BUDGET_S, spent)


def signs(bench: Bench) -> Attempt:
    """Pulse every thruster, correct its sign."""
    began = time.process_time()
    found = pulse_test(bench.fleet(1, True), bench.vehicle)
    spent = time.process_time() - began
    return Attempt(bench.fly(bench.policy, FixedSigns(bench.vehicle, found.signs), True), found.target_data_s, spent)


def particles(bench: Bench) -> Attempt:
    """Weigh vehicles of wide ranges by a flight of the target, train again around the likely ones."""
    began = time.process_time()
    task = bench.task()
    flight = fly(bench.fleet(1), bench.policy, draw_starts(task, 1, seed=1), round(BUDGET_S / task.control_dt))
    ranges = {
        **yaml.safe_load(config_path("randomization", "wide").read_text()),
        "thruster_gain": {"gain": [-1.5, 1.7]},
    }
    weighed = weigh_particles(bench.vehicle, ranges, flight, task.control_dt)
    policy = bench.train(bench.vehicle, weighed.ranges())
    return Attempt(bench.fly(policy), BUDGET_S, time.process_time() - began)


def trained(bench: Bench, vehicle: Vehicle, randomization: dict[str, Any]) -> Attempt:
    """A policy trained without target data."""
    began = time.process_time()
    policy = bench.train(vehicle, randomization)
    return Attempt(bench.fly(policy), 0.0, time.process_time() - began)


def wide() -> dict[str, Any]:
    """The ranges of the robust policy."""
    return yaml.safe_load(config_path("randomization", "wide").read_text())


METHODS: dict[str, Callable[[Bench], Attempt]] = {
    "u_s": lambda b: Attempt(b.fly(b.policy), 0.0, 0.0),
    "PID": lambda b: Attempt(b.fly(PID(b.task())), 0.0, 0.0),
    "PID with integral": lambda b: Attempt(b.fly(PID(b.task(), integral=INTEGRAL)), 0.0, 0.0),
    "pulse test, fixed signs": signs,
    "recursive least squares": lambda b: Attempt(
        b.fly(b.policy, RecursiveLeastSquares(b.vehicle, b.task(), b.count), True), 0.0, 0.0
    ),
    "DDR, 4 channels": lambda b: ddr(b, "affine"),
    "DDR to the thrusters": lambda b: ddr(b, "thrusters"),
    "online, in flight": lambda b: Attempt(
        b.fly(b.policy, OnlineAdapter(b.vehicle, b.task(), load_online_config(), b.count), True), 0.0, 0.0
    ),
    "true map (oracle)": lambda b: Attempt(b.fly(b.policy, TrueMap(b.vehicle, b.target), True), 0.0, 0.0),
}
TRAINING: dict[str, Callable[[Bench], Attempt]] = {
    "robust SAC": lambda b: trained(b, b.vehicle, wide()),
    "particle weights, trained again": particles,
    "SAC trained on the target (oracle)": lambda b: trained(b, b.target, {}),
}


def line(method: str, results: dict[str, tuple[Metrics, Attempt]]) -> str:
    """A method's row: worst mean over the scenarios it flew, and the mean of each scenario."""
    data = max(attempt.target_data_s for _, attempt in results.values())
    compute = float(np.median([attempt.compute_s for _, attempt in results.values()]))
    cells = [f"{m.mean_m:.3f} / {m.p95_m:.3f} / {m.worst_m:.3f}" for m, _ in results.values()]
    return f"| {method} | {data:.1f} | {compute:.2f} | " + " | ".join(cells) + " |"


def draw(table: dict[str, dict[str, tuple[Metrics, Attempt]]], path: Path) -> None:
    """Mean error of every method in every scenario as a heat map."""
    methods, scenarios = list(table), list(next(iter(table.values())))
    mean = np.array([[table[m][s][0].mean_m for s in scenarios] for m in methods])
    figure, axes = plt.subplots(figsize=(2 + 0.7 * len(scenarios), 1.5 + 0.4 * len(methods)), layout="constrained")
    shown = axes.imshow(np.log10(np.clip(mean, 1e-3, 10.0)), cmap="viridis_r", vmin=-3, vmax=1, aspect="auto")
    axes.set_xticks(range(len(scenarios)), scenarios, rotation=60, ha="right")
    axes.set_yticks(range(len(methods)), methods)
    for (i, j), value in np.ndenumerate(mean):
        text = f"{value:.3f}" if value < 0.995 else f"{value:.1f}"
        axes.text(j, i, text, ha="center", va="center", fontsize=7, color="white" if value > 0.1 else "black")
    bar = figure.colorbar(shown, ax=axes, ticks=range(-3, 2))
    bar.ax.set_yticklabels(["1 mm", "1 cm", "10 cm", "1 m", "10 m"])
    axes.set_title("Mean position error for t ≥ 10 s [m]")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=130)
    plt.close(figure)


def main() -> None:
    """Fly everything, print Markdown, draw the picture."""
    names = config_names("scenario")
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenarios", nargs="+", default=names, choices=names, help="default: all", metavar="NAME")
    parser.add_argument("--count", type=int, default=100, help="starts per scenario")
    parser.add_argument("--train", action="store_true", help="also the methods that train for each scenario")
    parser.add_argument("--policies", type=Path, default=PROJECT / "outputs" / "policies", help="store of policies")
    parser.add_argument("--picture", type=Path, default=PICTURE)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    vehicle = load_vehicle("paper")
    blank = Bench(vehicle, Scenario("nominal"), arguments.policies, arguments.count, None)
    policy = blank.train(vehicle, {})
    methods = {**METHODS, **(TRAINING if arguments.train else {})}
    table: dict[str, dict[str, tuple[Metrics, Attempt]]] = {method: {} for method in methods}
    for name in arguments.scenarios:
        config = yaml.safe_load(config_path("scenario", name).read_text())
        bench = replace(blank, scenario=read_scenario(name, config, vehicle), policy=policy)
        for method, attempt in methods.items():
            torch.manual_seed(0)
            done = attempt(bench)
            table[method][name] = (Metrics.of(done.flight), done)
    print(
        f"{arguments.count} starts in ±1 m, vehicle paper, 20 s. Cells: mean / 95th percentile / worst start of the "
        "mean position error for t ≥ 10 s, in m. Data: seconds flown on the target before the judged flight (methods "
        "without any learn during it, or not at all). Compute: median CPU seconds before the judged flight.\n"
    )
    print("| method | data [s] | compute [s] | " + " | ".join(arguments.scenarios) + " |")
    print("|" + "---|" * (3 + len(arguments.scenarios)))
    for method, results in table.items():
        print(line(method, results))
    draw(table, arguments.picture)
    print(f"\n![every method in every scenario]({arguments.picture.name})")


if __name__ == "__main__":
    main()
