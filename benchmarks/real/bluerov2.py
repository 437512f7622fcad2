"""``python -m benchmarks.real.bluerov2 FOLDER``: diagnose two runs of a real BlueROV2 Heavy, predict the third.

The third run is simulated from its commands alone, from its first sample to its last, with the published vehicle and
with what was found added. Prints Markdown; ``--folds`` lets every run be the third one once. Where to get the runs:
``docs/how-to/run-the-benchmarks.md``.
"""

import argparse
import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from auv_torchrl.diagnosis import Diagnosis, diagnose
from auv_torchrl.diagnosis.calibrate.parameters import load_uncertainty
from auv_torchrl.diagnosis.identify.hypotheses import apply_values
from auv_torchrl.flightlog import VELOCITY, Episode, FlightLog, join, read_flightlog
from auv_torchrl.physics import rest_state
from auv_torchrl.physics.kinematics import quaternion_from_euler
from auv_torchrl.simulator import simulate
from auv_torchrl.vehicle import Vehicle, load_vehicle
from benchmarks import show_progress

log = logging.getLogger(__name__)
VEHICLE = "bluerov2_heavy"
RUNS = ("run_11_40_38", "run_12_09_45", "run_11_10_52_sync")
TEST = "run_11_10_52_sync"  # yaw is never commanded in it
TO_BEAT = {  # on it: the best published figures, m/s, and the share of the yaw rate's variance accounted for
    "u": 0.049, "v": 0.044, "w": 0.042, "yaw": 0.6,
}  # fmt: skip
LABELS = ("published", "diagnosed", "to beat")  # vehicles of a run, in the order of their rows
COLUMNS = {"u": "surge", "v": "sway", "w": "heave", "yaw": "yaw rate VAF"}


@dataclass(frozen=True)
class Figures:
    """How one run is predicted before and after the others were diagnosed."""

    test: str
    before: dict[str, float]
    after: dict[str, float]


@dataclass(frozen=True)
class Tested(Figures):
    """With the diagnosis of all runs but that one."""

    diagnosis: Diagnosis


def predict(vehicle: Vehicle, episode: Episode) -> np.ndarray:
    """Body velocities (T, 6) at the samples, simulated from the first sample on by the commands alone."""
    pose, velocity = np.nan_to_num(episode.pose[:1]), np.nan_to_num(episode.velocity[:1])
    start = rest_state(pose[:, :3], quaternion_from_euler(*pose[:, 3:].T), velocity, vehicle.thrusters)
    return simulate(vehicle, episode.commands[None, :-1], episode.t, start).states[0, :, 7:]


def figures(vehicle: Vehicle, flight: FlightLog) -> dict[str, float]:
    """Root mean square error per velocity, and under ``yaw`` the share of the yaw rate's variance accounted for."""
    measured = np.concatenate([episode.velocity for episode in flight.episodes])
    error = np.concatenate([predict(vehicle, episode) for episode in flight.episodes]) - measured
    rmse = np.sqrt(np.nanmean(error**2, axis=0))
    yaw = VELOCITY.index("r")
    accounted = 1 - np.nanvar(error[:, yaw]) / np.nanvar(measured[:, yaw])
    return {**dict(zip(VELOCITY, rmse.tolist(), strict=True)), "yaw": float(accounted)}


def leave_out(test: str, flights: dict[str, FlightLog]) -> Tested:
    """Diagnose the other runs, add what is found, and predict the one that was left out."""
    vehicle = load_vehicle(VEHICLE)
    learn = join(flight for name, flight in flights.items() if name != test)
    diagnosis = diagnose(
        learn,
        vehicle,
        test=[flights[test]],
        vehicle_name=VEHICLE,
        uncertainty=load_uncertainty(VEHICLE, vehicle),
        progress=lambda step, share: log.info("%s: %s", test, step),
    )
    found = {e.name: {k: p.value for k, p in e.parameters.items()} for e in diagnosis.effects}
    before, after = (figures(v, flights[test]) for v in (vehicle, apply_values(vehicle, found)))
    return Tested(test, before, after, diagnosis)


def table(results: Sequence[Figures]) -> Iterator[str]:
    """Lines of Markdown: figures before and after on each run that was left out."""
    yield f"| open loop on | vehicle | {' | '.join(COLUMNS.values())} |"
    yield "|---|---|" + "---|" * len(COLUMNS)
    for tested in results:
        figures = [tested.before, tested.after, *([TO_BEAT] if tested.test == TEST else [])]
        for label, values in zip(LABELS, figures, strict=False):
            shown = (f"{values[key]:.2f}" if key == "yaw" else f"{values[key]:.3f}" for key in COLUMNS)
            yield f"| {tested.test} | {label} | {' | '.join(shown)} |"


def words(diagnosis: Diagnosis) -> Iterator[str]:
    """Lines of Markdown: the verdict, what was found, and what it rests on."""
    yield f"**{diagnosis.verdict.key}** {diagnosis.summary}"
    yield ""
    for effect in diagnosis.effects:
        yield f"- {effect.name}: {effect.clause}"
    for finding in diagnosis.findings:
        yield f"- ({finding.code}) {finding.sentence}"


def check_runs(folder: Path) -> None:
    """Look whether all runs are there.

    Raises:
        FileNotFoundError: if one is missing; the message says which.
    """
    if missing := [name for name in RUNS if not (folder / f"{name}.csv").is_file()]:
        raise FileNotFoundError(
            f"{folder} lacks {', '.join(f'{name}.csv' for name in missing)}: "
            "docs/how-to/run-the-benchmarks.md says where to get them"
        )


def read_runs(folder: Path) -> dict[str, FlightLog]:
    """The runs by name.

    Raises:
        FileNotFoundError: if one is missing; the message says which.
    """
    check_runs(folder)
    vehicle = load_vehicle(VEHICLE)
    return {name: read_flightlog(folder / f"{name}.csv", vehicle) for name in RUNS}


def main() -> None:
    """Print tables and words."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("folder", type=Path, help=f"with {', '.join(f'{name}.csv' for name in RUNS)}")
    parser.add_argument("--folds", action="store_true", help="let every run be the one that is left out")
    options = parser.parse_args()
    show_progress()
    torch.set_num_threads(1)
    try:
        flights = read_runs(options.folder)
    except FileNotFoundError as error:
        parser.error(str(error))
    tests = [TEST, *(name for name in RUNS if name != TEST)] if options.folds else [TEST]
    results = [leave_out(test, flights) for test in tests]
    print("\n".join([*table(results), "", *words(results[0].diagnosis)]))


if __name__ == "__main__":
    main()
