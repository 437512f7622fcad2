"""How well a torpedo and a surface vessel hold depth and heading at speed, before and after a fault is adapted to."""

import logging
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
import torch
from hydra import compose, initialize_config_dir
from torch import Tensor

from auv_torchrl.adaptation.config import SETTLED_S
from auv_torchrl.command.chosen import NOMINAL
from auv_torchrl.evaluation import STEADY_FROM_S
from auv_torchrl.experiment import schema
from auv_torchrl.experiment.console import Stages
from auv_torchrl.experiment.in_flight import fly_in_flight
from auv_torchrl.experiment.run import perform, source_policy
from auv_torchrl.experiment.setup import Experiment, read_experiment
from auv_torchrl.flight import Flight
from auv_torchrl.paths import CONF
from auv_torchrl.tasks import Task
from auv_torchrl.tasks.underway import Underway

log = logging.getLogger(__name__)
SCENARIOS = {
    "remus100": ("fin_reversed", "fin_offset", "fin_stuck"),
    "otter": ("swap",),
    "milliampere": ("azimuth_reversed", "azimuth_offset", "azimuth_stuck"),
}
TOGETHER = ("remus100", "otter")  # vehicles of one table; another one has a table of its own
SEEDS = 3
LAST_S = 5.0  # of a flight, by which the slowest turn has ended
CONTROLLERS = {"nominal": "u_s", "u_s": "u_s", "u_t": "u_t, map from 8 s"}  # flights of a run: who flew
IN_FLIGHT = "u_s, adapting in flight"
ADAPTING = 20  # starts that are flown with the adaptation in flight
HEALTHY = "none"
Case = tuple[str, str, str]  # vehicle, scenario, controller


def cases(vehicles: Sequence[str] = TOGETHER) -> set[Case]:
    """What is flown of some vehicles: the rows of a table."""
    every = (*CONTROLLERS.values(), IN_FLIGHT)
    healthy = {(vehicle, HEALTHY, "u_s") for vehicle in vehicles}
    return healthy | {(vehicle, name, who) for vehicle in vehicles for name in SCENARIOS[vehicle] for who in every}


class Errors(NamedTuple):
    """Mean absolute errors of the flights of one run, over the starts and some time; NaN of a depth that is free."""

    depth_m: float
    last_depth_m: float
    heading_rad: float
    last_heading_rad: float

    @classmethod
    def of(cls, flight: Flight, dives: bool, since_s: Tensor | float = STEADY_FROM_S) -> Self:
        """From a time on, (N,) s or the same for all, and over the last seconds; of vehicles that dive, or do not."""
        time = flight.time.double()
        last = time[:, -1:] - LAST_S
        spans = [time >= since - 1e-6 for since in (torch.as_tensor(since_s).reshape(-1, 1), last)]
        depth, heading = flight.position_error.double(), flight.heading_error.double()
        if not dives:
            depth = math.nan * depth
        return cls(*(float(error[span].mean()) for error in (depth, heading) for span in spans))


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


def adapting(run: Experiment) -> tuple[Errors, str]:
    """Errors from 10 s after the fault, which comes in flight, and a line on how it was noticed."""
    few = replace(run, starts=run.starts[:ADAPTING])
    flown = fly_in_flight(few, source_policy(run).module)
    since = flown.schedule.changes[0].at_s + SETTLED_S
    found = flown.recovered[0]
    noticed = found.alarm_s.isfinite()
    late = float(found.alarm_s[noticed].quantile(0.9, interpolation="higher")) if noticed.any() else math.inf
    said = f"noticed {int(noticed.sum())} of {len(noticed)}, 90 % of these within {late:.2f} s, "
    said += f"false alarms before: {int(found.alarms_before.sum())}"
    return Errors.of(flown.adapted.flight, diving(run.task), since), said


def fly_cases(vehicle: str, seed: int, policies: Path, overrides: Sequence[str] = ()) -> Iterator[tuple[Case, Errors]]:
    """Every scenario of a vehicle with the policy of one seed."""
    for number, scenario in enumerate(SCENARIOS[vehicle]):
        run = experiment(vehicle, scenario, seed, policies, overrides)
        outcome = perform(run, Stages(7))
        for name, flight in outcome.flights.items():
            if name != "nominal" or number == 0:  # the same in every scenario
                case = (vehicle, HEALTHY if name == "nominal" else scenario, CONTROLLERS[name])
                yield case, Errors.of(flight, diving(run.task))
        errors, said = adapting(run)
        log.info("%s, %s, in flight: %s", vehicle, scenario, said)
        yield (vehicle, scenario, IN_FLIGHT), errors


def measure(
    policies: Path, seeds: int = SEEDS, overrides: Sequence[str] = (), vehicles: Sequence[str] = TOGETHER
) -> list[str]:
    """Train some vehicles with each seed, or take what was trained before, fly everything; Markdown."""
    table: dict[Case, list[Errors]] = {}
    for vehicle in vehicles:
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
    return [spread(column, unit) for column, unit in zip(columns, units, strict=True)]


def spread(values: np.ndarray, unit: str) -> str:
    """The mean, and the smallest and the largest of several; a dash where there is none."""
    if not np.isfinite(values).all():
        return "–"
    shown = f"{_digits(values.mean())}{unit}"
    return shown if len(values) == 1 else f"{shown} ({_digits(values.min())} to {_digits(values.max())})"


def _digits(value: float) -> str:
    return f"{value:.1f}" if value < 10 else f"{value:.0f}"
