"""How well a torpedo and a surface vessel hold depth and heading at speed, before and after a fault is adapted to."""

import logging
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
from hydra import compose, initialize_config_dir

from auv_torchrl.command.chosen import NOMINAL
from auv_torchrl.evaluation import STEADY_FROM_S
from auv_torchrl.experiment import schema
from auv_torchrl.experiment.console import Stages
from auv_torchrl.experiment.run import perform
from auv_torchrl.experiment.setup import Experiment, read_experiment
from auv_torchrl.flight import Flight
from auv_torchrl.paths import CONF
from auv_torchrl.tasks import Task
from auv_torchrl.tasks.underway import Underway

log = logging.getLogger(__name__)
SCENARIOS = {"remus100": ("fin_reversed", "fin_offset", "fin_stuck"), "otter": ("swap",)}
SEEDS = 3
LAST_S = 5.0  # of a flight, by which the slowest turn has ended
CONTROLLERS = {"nominal": "u_s", "u_s": "u_s", "u_t": "u_t, map from 8 s"}  # flights of a run: who flew
HEALTHY = "none"
ROWS = {
    (vehicle, scenario, controller)
    for vehicle, scenarios in SCENARIOS.items()
    for scenario, controllers in ((HEALTHY, ("u_s",)), *((name, tuple(CONTROLLERS.values())) for name in scenarios))
    for controller in controllers
}
Case = tuple[str, str, str]  # vehicle, scenario, controller


class Errors(NamedTuple):
    """Mean absolute errors of the flights of one run, over the starts and some time; NaN of a depth that is free."""

    depth_m: float
    last_depth_m: float
    heading_rad: float
    last_heading_rad: float

    @classmethod
    def of(cls, flight: Flight, dives: bool) -> Self:
        """From 10 s on, and over the last seconds; of vehicles that dive, or do not."""
        time = flight.time[0].double()
        spans = [time >= since - 1e-6 for since in (STEADY_FROM_S, float(time[-1]) - LAST_S)]
        depth, heading = flight.position_error.double(), flight.heading_error.double()
        if not dives:
            depth = math.nan * depth
        return cls(*(float(error[:, span].mean()) for error in (depth, heading) for span in spans))


def experiment(vehicle: str, scenario: str, seed: int, policies: Path, overrides: Sequence[str] = ()) -> Experiment:
    """What ``train.py +experiment=cruise vehicle=... +scenario=... seed=...`` does, without the flight of the fault."""
    schema.register()
    given = ["+experiment=cruise", f"vehicle={vehicle}", f"seed={seed}", f"policies={policies}", "flight.fly=false"]
    chosen = [] if scenario == NOMINAL else [f"+scenario={scenario}"]
    with initialize_config_dir(version_base="1.3", config_dir=str(CONF)):
        return read_experiment(compose("train", [*given, *chosen, *overrides]), scenario)


def diving(task: Task) -> bool:
    """Whether a task controls a depth."""
    return isinstance(task, Underway) and task.dives


def fly_cases(vehicle: str, seed: int, policies: Path, overrides: Sequence[str] = ()) -> Iterator[tuple[Case, Errors]]:
    """Every scenario of a vehicle with the policy of one seed."""
    for number, scenario in enumerate(SCENARIOS[vehicle]):
        run = experiment(vehicle, scenario, seed, policies, overrides)
        outcome = perform(run, Stages(7))
        for name, flight in outcome.flights.items():
            if name != "nominal" or number == 0:  # the same in every scenario
                case = (vehicle, HEALTHY if name == "nominal" else scenario, CONTROLLERS[name])
                yield case, Errors.of(flight, diving(run.task))


def measure(policies: Path, seeds: int = SEEDS, overrides: Sequence[str] = ()) -> list[str]:
    """Train with each seed, or take what was trained before, fly everything; Markdown."""
    table: dict[Case, list[Errors]] = {}
    for vehicle in SCENARIOS:
        for seed in range(seeds):
            log.info("%s, seed %d: training, unless it was trained before", vehicle, seed)
            for case, errors in fly_cases(vehicle, seed, policies, overrides):
                table.setdefault(case, []).append(errors)
                log.info("%s, seed %d: %s", ", ".join(case), seed, ", ".join(cells([errors])))
    return report(table)


def report(table: Mapping[Case, Sequence[Errors]]) -> list[str]:
    """A row per vehicle, scenario and controller."""
    heads = ("vehicle", "fault", "controller", "depth, 10 s to 30 s", "the last 5 s", "heading, 10 s to 30 s")
    lines = [f"| {' | '.join((*heads, 'the last 5 s'))} |", "|---|---|---|---:|---:|---:|---:|"]
    lines += [f"| {' | '.join((*case, *cells(runs)))} |" for case, runs in table.items()]
    return lines


def cells(runs: Sequence[Errors]) -> list[str]:
    """Depths in cm and headings in degrees: the mean of the runs, and the smallest and the largest."""
    columns = np.array(runs).T * np.array([[100.0], [100.0], [180 / math.pi], [180 / math.pi]])
    units = (" cm", " cm", "°", "°")
    return [_spread(column, unit) for column, unit in zip(columns, units, strict=True)]


def _spread(values: np.ndarray, unit: str) -> str:
    if not np.isfinite(values).all():
        return "–"
    shown = f"{_digits(values.mean())}{unit}"
    return shown if len(values) == 1 else f"{shown} ({_digits(values.min())} to {_digits(values.max())})"


def _digits(value: float) -> str:
    return f"{value:.1f}" if value < 10 else f"{value:.0f}"
