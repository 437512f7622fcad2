"""``python -m benchmarks.real.ardusub``: diagnose flights that ArduSub's firmware wrote of its own simulated vehicle.

What was wrong with each is known. Prints a Markdown table: verdict, what is named, its value and probability, whether
all of that is right or half right (``benchmarks.scoring``), and the processor time. ``--healthy`` gives each flight
another one that was sound, of the same sensors; ``--altered`` takes sound flights as faulty vehicles would have logged
them. Logs that are absent are named. They are looked for in the folder that ``AUV_TORCHRL_DATA`` names, else in
``../shared/data``.
"""

import argparse
import logging
import lzma
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch

from auv_torchrl.diagnosis import Diagnosis, diagnose
from auv_torchrl.diagnosis.calibrate.parameters import load_uncertainty
from auv_torchrl.diagnosis.verdict import to_json
from auv_torchrl.effects.effect import changed
from auv_torchrl.flightlog import FlightLog, read_flightlog
from auv_torchrl.vehicle import Vehicle, load_vehicle
from benchmarks import show_progress
from benchmarks.real import DATA
from benchmarks.real.altered import Change, carried, exchanged, multiplied, without_position
from benchmarks.scoring import Score, fault, score_diagnosis, sound

log = logging.getLogger(__name__)
VEHICLE = "ardusub_sitl"
FOLDER = "ardusub_sitl"
ENDS = (".BIN", ".BIN.xz")


@dataclass(frozen=True)
class Case:
    """One flight and what is known of it."""

    name: str
    healthy: str | tuple[str, ...] | None  # other flights that were sound, where there are any
    effect: str = ""  # none: nothing was wrong
    truth: dict[str, float] = field(default_factory=dict)  # by parameter
    flight: str = ""  # file; empty: as the case is called
    alter: Change | None = None  # what the log of a sound flight is changed by
    sensors: Change | None = None  # what both logs lack
    onset_s: float | None = None  # from when on it acts; None: always

    @property
    def file(self) -> str:
        """Name of the log."""
        return self.flight or self.name

    @property
    def sound(self) -> tuple[str, ...]:
        """Names of the logs of other flights that were sound."""
        return (self.healthy,) if isinstance(self.healthy, str) else self.healthy or ()

    @property
    def has_healthy(self) -> bool:
        """Whether there is such a flight."""
        return bool(self.sound)


def pushing_evenly(vehicle: Vehicle) -> Vehicle:
    """The vehicle with thrusters as ArduSub's simulator has them: they push as hard both ways, whatever a file says."""
    even = np.ones_like(vehicle.forward_gain)
    return changed(vehicle, asymmetry=0.0 * vehicle.asymmetry, forward_gain=even, reverse_gain=even)


CASES = (  # the README beside the logs tells what was wrong
    Case("healthy_a", "healthy_c"),
    Case("healthy_c", "healthy_a"),
    Case("dead_thruster3", "healthy_a", "thruster_gain", {"gain_3": 0.0}),
    Case("motdir1_minus", "healthy_a", "thruster_gain", {"gain_1": -1.0}),
    Case("buoyancy10N", "healthy_a", "buoyancy", {"force": -5.6}),
    Case("stock_healthy_a", None),
    Case("stock_dead_thruster4", "stock_healthy_a", "thruster_gain", {"gain_4": 0.0}),
)

VECTORED_FOLDER = "ardusub_vectored"
_BOTH = ("v_healthy_a", "v_healthy_b")
VECTORED = (
    Case("v_healthy_a", "v_healthy_b"),
    Case("v_healthy_b", "v_healthy_a"),
    Case("v_reversed4", _BOTH, "thruster_gain", {"gain_4": -1.0}),
    Case("v_motdir3_minus", _BOTH, "thruster_gain", {"gain_3": -1.0}),
)

A, C = "healthy_a", "healthy_c"
GAIN, SWAP = "thruster_gain", "thruster_swap"
ALTERED = (
    Case("leads_2_3", A, SWAP, {"command_2": 3.0, "command_3": 2.0}, C, exchanged(2, 3)),
    Case("leads_6_8", A, SWAP, {"command_6": 8.0, "command_8": 6.0}, C, exchanged(6, 8)),
    Case("reversed_5", A, GAIN, {"gain_5": -1.0}, C, multiplied(5, -1.0)),
    Case("weak_1", A, GAIN, {"gain_1": 0.7}, C, multiplied(1, 0.7)),
    Case("weak_7", A, GAIN, {"gain_7": 0.5}, C, multiplied(7, 0.5)),
    Case("current", A, "current", {"north": 0.15, "east": -0.1}, C, carried(0.15, -0.1)),
    Case("reversed_2_late", A, GAIN, {"gain_2": -1.0}, C, multiplied(2, -1.0, 100.0), onset_s=100.0),
    Case("leads_1_4_late", A, SWAP, {"command_1": 4.0, "command_4": 1.0}, C, exchanged(1, 4, 90.0), onset_s=90.0),
    Case("stock_sound", A, flight=C, sensors=without_position),
    Case("stock_leads_1_2", A, SWAP, {"command_1": 2.0, "command_2": 1.0}, C, exchanged(1, 2), without_position),
    Case("stock_reversed_3", A, GAIN, {"gain_3": -1.0}, C, multiplied(3, -1.0), without_position),
    Case("stock_weak_7", A, GAIN, {"gain_7": 0.5}, C, multiplied(7, 0.5), without_position),
)  # fmt: skip


@dataclass(frozen=True)
class Result:
    """A diagnosis of a case."""

    case: Case
    diagnosis: Diagnosis
    vehicle: Vehicle  # that it started from
    seconds: float  # of the processor

    @property
    def score(self) -> Score:
        """How right it is, by the rule of all benchmarks."""
        case = self.case
        truth = fault({case.effect: case.truth}, case.onset_s) if case.effect else sound()
        return score_diagnosis(to_json(self.diagnosis), truth, pushing_evenly(self.vehicle))

    @property
    def row(self) -> tuple[str, ...]:
        """The cells of its line in the table; what corrects the vehicle's file is not named there."""
        found, case = self.diagnosis, self.case
        truth = _values(case.effect, case.truth) if case.effect else "nothing"
        truth += f" from {case.onset_s:.0f} s on" if case.onset_s is not None else ""
        named = "; ".join(
            f"{_values(e.name, {k: p.value for k, p in e.parameters.items()})} (p {e.probability:.2f})"
            for e in found.effects
            if not e.calibrates
        )
        closed = "" if found.gap.closed is None else f"{found.gap.closed:.2f}"
        return case.name, truth, found.verdict.key, named, closed, *self.score.cells, f"{self.seconds:.0f}"


def run(case: Case, folder: Path, vehicle_name: str, with_healthy: bool) -> Result:
    """Read and diagnose one flight, alone or with the healthy ones."""
    begin, vehicle = time.process_time(), load_vehicle(vehicle_name)
    flight = read(folder, case.file, vehicle)
    healthy = [read(folder, name, vehicle) for name in case.sound] if with_healthy else []
    if case.alter:
        flight = case.alter(flight)
    if case.sensors:
        flight, healthy = case.sensors(flight), [case.sensors(log) for log in healthy]
    found = diagnose(
        flight,
        vehicle,
        healthy,
        vehicle_name=vehicle_name,
        uncertainty=load_uncertainty(vehicle_name, vehicle),
        progress=lambda step, share: log.info("%s: %s", case.name, step),
    )
    return Result(case, found, vehicle, time.process_time() - begin)


def table(rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """Lines of Markdown, each as soon as its row is there, and how many are right."""
    yield "| log | what was wrong | verdict | named | closed | right | half right | CPU s |"
    yield "|---|---|---|---|---|---|---|---|"
    scores: Counter[tuple[str, ...]] = Counter()
    for row in rows:
        scores[tuple(row[-3:-1])] += 1
        yield f"| {' | '.join(row)} |"
    yield ""
    yield f"{scores[Score.RIGHT.cells]} of {scores.total()} right, {scores[Score.HALF.cells]} half right."


def _values(effect: str, values: dict[str, float]) -> str:
    return f"{effect} " + ", ".join(f"{name} {value:.2f}" for name, value in values.items())


def read(folder: Path, name: str, vehicle: Vehicle) -> FlightLog:
    """A flight, packed (.xz) or not."""
    plain, packed = folder / f"{name}.BIN", folder / f"{name}.BIN.xz"
    if plain.is_file():
        return read_flightlog(plain, vehicle)
    with TemporaryDirectory() as unpacked:
        path = Path(unpacked) / plain.name
        path.write_bytes(lzma.decompress(packed.read_bytes()))
        return read_flightlog(path, vehicle)


def absent(case: Case, folder: Path, with_healthy: bool) -> str:
    """What a folder lacks for a case; empty: nothing."""
    needed = (case.file, *case.sound) if with_healthy else (case.file,)
    lacks = [f"{name}.BIN" for name in needed if not any((folder / f"{name}{end}").is_file() for end in ENDS)]
    if with_healthy and not case.has_healthy:
        lacks.append("a sound flight of the same sensors")
    return f"{folder} lacks {', '.join(lacks)}" if lacks else ""


def find_cases(folder: Path, names: Sequence[str], with_healthy: bool, cases: Iterable[Case]) -> list[Case]:
    """Those whose flights are there; those whose are not are named."""
    here = []
    for case in cases:
        if names and case.name not in names:
            continue
        if lacks := absent(case, folder, with_healthy):
            log.info("%s is left out: %s", case.name, lacks)
            continue
        here.append(case)
    return here


def main() -> None:
    """Diagnose what is there and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    known = [case.name for case in (*CASES, *ALTERED, *VECTORED)]
    parser.add_argument("names", nargs="*", help=f"of {', '.join(known)}; all if not given")
    parser.add_argument("--data", type=Path, default=DATA, help=f"folder with {FOLDER}/*.BIN")
    parser.add_argument("--healthy", action="store_true", help="give each flight another one that was sound")
    kind = parser.add_mutually_exclusive_group()
    kind.add_argument("--altered", action="store_true", help="sound flights as faulty vehicles would have logged them")
    kind.add_argument("--vectored", action="store_true", help=f"flights of six thrusters, in {VECTORED_FOLDER}")
    parser.add_argument("--vehicle", default=VEHICLE, help="bluerov2_heavy is wrong about these flights, as files are")
    options = parser.parse_args()
    cases = ALTERED if options.altered else VECTORED if options.vectored else CASES
    folder = options.data / (VECTORED_FOLDER if options.vectored else FOLDER)
    if unknown := set(options.names) - {case.name for case in cases}:
        parser.error(f"no log named {', '.join(sorted(unknown))}: give some of {', '.join(c.name for c in cases)}")
    show_progress()
    torch.set_num_threads(1)
    here = find_cases(folder, options.names, options.healthy, cases)
    for line in table(run(case, folder, options.vehicle, options.healthy).row for case in here):
        print(line, flush=True)


if __name__ == "__main__":
    main()
