"""How far beside a path a torpedo and a surface vessel go at speed, steered by line of sight."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, Self

import torch

from auv_torchrl.command.chosen import NOMINAL
from auv_torchrl.evaluation import STEADY_FROM_S, draw_starts, fly
from auv_torchrl.experiment.run import source_policy
from auv_torchrl.flight import Flight
from auv_torchrl.tasks import Route
from benchmarks.underway.control import LAST_S, TOGETHER, diving, experiment, spread

log = logging.getLogger(__name__)
PATHS: dict[str, dict[str, Any]] = {  # settings of the task; the first is trained on
    "square of 60 m, turns of 15 m": {},
    "line": {"north_m": (0.0, 200.0), "east_m": (0.0, 0.0), "down_m": (0.0, 0.0), "closed": False},
    "circle of 20 m": {"north_m": (0.0, 40.0, 40.0, 0.0), "east_m": (0.0, 0.0, 40.0, 40.0), "corner_m": 20.0},
}
ROWS = {(vehicle, path) for vehicle in TOGETHER for path in PATHS}
LENGTH_S = 60.0
Case = tuple[str, str]


class Across(NamedTuple):
    """Mean distances of the flights of one policy, m; NaN of a depth that is free."""

    across_m: float
    last_m: float
    depth_m: float

    @classmethod
    def of(cls, flight: Flight, dives: bool) -> Self:
        """From 10 s on, and over the last seconds."""
        off = (flight.position - flight.reference_position).double()
        time = flight.time.double()
        late, last = time >= STEADY_FROM_S - 1e-6, time >= time[:, -1:] - LAST_S - 1e-6
        across = torch.linalg.vector_norm(off[..., :2], dim=-1)
        depth = float(off[..., 2].abs()[late].mean()) if dives else float("nan")
        return cls(float(across[late].mean()), float(across[last].mean()), depth)


def fly_paths(
    vehicle: str, seed: int, policies: Path, overrides: Sequence[str] = (), length_s: float = LENGTH_S
) -> dict[Case, Across]:
    """Train on the first path with a seed, or take what was trained before, and fly all of them."""
    run = experiment(vehicle, NOMINAL, seed, policies, ("task=route", *overrides))
    policy, found = source_policy(run).module, {}
    for name, settings in PATHS.items():
        assert isinstance(run.exam, Route)
        task = replace(run.exam, episode_s=length_s, **settings)
        starts = draw_starts(task, len(run.starts), run.starts_seed)
        fleet = replace(run, exam=task).fleet(len(starts))
        found[vehicle, name] = Across.of(fly(fleet, policy, starts, task.steps), diving(task))
    return found


def measure(policies: Path, seeds: int, overrides: Sequence[str] = ()) -> list[str]:
    """All paths with the policies of some seeds; Markdown."""
    table: dict[Case, list[Across]] = {}
    for vehicle in TOGETHER:
        for seed in range(seeds):
            log.info("%s, seed %d: training on a path, unless it was trained before", vehicle, seed)
            for case, across in fly_paths(vehicle, seed, policies, overrides).items():
                table.setdefault(case, []).append(across)
                log.info("%s, seed %d: %.2f m", ", ".join(case), seed, across.across_m)
    return report(table)


def report(table: Mapping[Case, Sequence[Across]]) -> list[str]:
    """A row per vehicle and path."""
    lines = ["| vehicle | path | across the path, from 10 s | the last 5 s | depth |", "|---|---|---:|---:|---:|"]
    for case, runs in table.items():
        columns = (100.0 * torch.tensor(runs, dtype=torch.float64)).T.numpy()
        lines.append(f"| {' | '.join((*case, *(spread(column, ' cm') for column in columns)))} |")
    return lines
