"""``python -m benchmarks.real.rov2016``: runs of a real BlueROV of 2016; to which thruster does each of them point?

A six-thruster BlueROV in a pool (master's thesis, Linköping; github.com/MrEkelund/ExjobbROV): attitude, rates,
accelerations and outputs, no position and no speed. On one day, in April, the propeller of thruster 6 was broken, and
the runs of that day turn over; in May the controller moves thrusters 1, 2 and 5 together, and 3 and 4, and not 6. The
vehicle's file is of published estimates that differ by factors of two, no sound run is given, and each run is diagnosed
by itself.
"""

import argparse
import lzma
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from auv_torchrl.diagnosis import Diagnosis, diagnose
from auv_torchrl.diagnosis.calibrate.parameters import load_uncertainty
from auv_torchrl.flightlog import FlightLog, read_flightlog
from auv_torchrl.flightlog.streams.options import read_options
from auv_torchrl.vehicle import Vehicle, load_vehicle
from benchmarks.real import DATA

FOLDER = "exjobb_bluerov"
HERE = Path(__file__).parent
VEHICLE = str(HERE / "rov2016.yaml")
APRIL, MAY = "rov2016_april.yaml", "rov2016_may.yaml"  # what the columns of a day are
BROKEN = 6  # the thruster whose propeller was broken on the day of April
RUNS = {  # run: file, mapping
    "test1_roll_pitch": ("test1_roll_pitch_2016-04-04-15-11-53", APRIL),
    "test2_roll_pitch": ("test2_roll_pitch_2016-04-04-15-14-44", APRIL),
    "test3_roll_pitch": ("test3_roll_pitch_2016-04-04-15-16-43", APRIL),
    "test2_all": ("test2_all_2016-04-04-15-27-58", APRIL),
    "sinPhiA1F05": ("sinPhiA1F05_2016-05-25-08-47-49", MAY),
    "sinThetaA1F05": ("sinThetaA1F05_2016-05-25-08-54-21", MAY),
    "sinAllAttitudeA1": ("sinAllAttitudeA1_2016-05-25-09-06-44", MAY),
    "stepAllAttitude": ("stepAllAttitude_2016-05-25-09-14-26", MAY),
    "thruster6Lowontrol": ("thruster6Lowontrol_2016-05-25-09-32-19", MAY),
}
DEAD = 0.3  # of what the others give: with less a thruster is called dead
POINTS = 0.5  # share of what is located at thrusters, above which a run points at one


@dataclass(frozen=True)
class Pointed:
    """Which thruster a diagnosis points at, and what it says of it."""

    verdict: str
    headline: str
    thruster: int | None  # that most of the gap is located at
    dead: dict[int, float]  # thrusters called dead, not less likely than not: what they give of what the others give

    @classmethod
    def of(cls, found: Diagnosis) -> "Pointed":
        """By where the gap was located, and by the gains that were found."""
        located = {int(number): share for number, share in found.where.thruster.items()}
        first = max(located, key=lambda number: located[number], default=None)
        first = None if first is None or located[first] <= POINTS else first
        dead: dict[int, float] = {}
        for effect in found.effects:
            gains = {int(name[5:]): e.value for name, e in effect.parameters.items() if name.startswith("gain_")}
            if gains and effect.probability >= POINTS:
                others = float(np.median(list(gains.values()))) if len(gains) > 2 else 1.0
                dead |= {number: gain / others for number, gain in gains.items() if abs(gain) < DEAD * abs(others)}
        return cls(found.verdict.key, found.headline, first, dead)

    def is_right(self, broken: int | None) -> bool:
        """Whether it points at the broken thruster alone; where all work, at none."""
        return set(self.dead) <= {broken} and self.thruster == broken


def broken_in(run: str) -> int | None:
    """The thruster that was broken in a run."""
    return BROKEN if RUNS[run][1] == APRIL else None


def missing(data: Path, run: str) -> str:
    """What a folder lacks for a run; empty: nothing."""
    path = data / FOLDER / f"{RUNS[run][0]}.csv.xz"
    return "" if path.is_file() else f"{data / FOLDER} lacks {path.name}"


def read(folder: Path, run: str, vehicle: Vehicle) -> FlightLog:
    """A run of this vehicle, as its mapping says."""
    file, mapping = RUNS[run]
    with TemporaryDirectory() as unpacked:
        path = Path(unpacked) / f"{file}.csv"
        path.write_bytes(lzma.decompress((folder / f"{path.name}.xz").read_bytes()))
        return read_flightlog(path, vehicle, options=read_options(mapping=HERE / mapping))


def measure(data: Path, run: str) -> Mapping[str, Any]:
    """Diagnose one run; the cells of its line in the table."""
    begin, vehicle = time.process_time(), load_vehicle(VEHICLE)
    log = read(data / FOLDER, run, vehicle)
    found = diagnose(log, vehicle, vehicle_name="rov2016", uncertainty=load_uncertainty(VEHICLE, vehicle))
    seconds = time.process_time() - begin
    pointed, broken = Pointed.of(found), broken_in(run)
    dead = ", ".join(f"{number} ({share:.2f} of the others)" for number, share in pointed.dead.items())
    truth = "all thrusters work" if broken is None else f"propeller {broken} broken"
    cells = (
        run, truth, pointed.verdict, pointed.headline, "" if pointed.thruster is None else str(pointed.thruster), dead,
        "yes" if pointed.is_right(broken) else "no", f"{seconds:.0f}",
    )  # fmt: skip
    return {"row": cells}


def table(results: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    """Lines of Markdown, each as soon as its row is there, and how many are right."""
    yield "| run | truth | verdict | headline | points at | called dead | right | CPU s |"
    yield "|---|---|---|---|---|---|---|---|"
    right, pointed = {False: [0, 0], True: [0, 0]}, Counter[str]()
    for result in results:
        row = result["row"]
        count = right[broken_in(row[0]) is not None]
        count[0] += row[-2] == "yes"
        count[1] += 1
        pointed.update([row[4]] if row[4] and broken_in(row[0]) else [])
        yield f"| {' | '.join(row)} |"
    yield ""
    (sound, sounds), (broken, brokens) = right[False], right[True]
    yield (
        f"{broken} of {brokens} runs with the broken propeller point at it (must 80 %, aim 95 %); in {sounds - sound} "
        f"of {sounds} in which all thrusters work one is pointed at or called dead (must 0)."
    )
    if pointed:
        first, times = pointed.most_common(1)[0]
        yield ""
        yield f"Of {pointed.total()} runs with the broken propeller that point at a thruster, {times} point at {first}."


def main() -> None:
    """Diagnose what is there and print the table, line by line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("runs", nargs="*", help=f"of {', '.join(RUNS)}; all if not given")
    parser.add_argument("--data", type=Path, default=DATA, help=f"folder with {FOLDER}/*.csv.xz")
    options = parser.parse_args()
    if unknown := set(options.runs) - set(RUNS):
        parser.error(f"no run named {', '.join(sorted(unknown))}: give some of {', '.join(RUNS)}")
    chosen = [run for run in RUNS if not options.runs or run in options.runs]
    lacking = [lacks for run in chosen if (lacks := missing(options.data, run))]
    if lacking:
        parser.error("; ".join(lacking))
    for line in table(measure(options.data, run) for run in chosen):
        print(line, flush=True)


if __name__ == "__main__":
    main()
