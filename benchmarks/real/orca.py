"""``python -m benchmarks.real.orca``: logs of a real BlueROV2 over a year, most of which hold no dive; what is said?

One developer's vehicle near Seattle (github.com/clydemcqueen/orca4_1_tests): attitude, rates, accelerations, depth and
outputs, no position and no speed. No fault of a thruster is noted. The vehicle's file is the published one, which is a
guess, no sound dive is given, and each log is diagnosed by itself; then all of them are followed as many dives.
"""

import argparse
import lzma
import re
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from auv_torchrl.diagnosis import Diagnosis, Verdict, diagnose
from auv_torchrl.diagnosis.calibrate.parameters import load_uncertainty
from auv_torchrl.diagnosis.doubt import doubts
from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.diagnosis.localize.wording import does_otherwise
from auv_torchrl.flightlog import FlightLogError, read_flightlog
from auv_torchrl.flightlog.streams.options import read_options
from auv_torchrl.monitoring.changes import find_changes
from auv_torchrl.monitoring.dive_work import DivePlan, Work, follow_all
from auv_torchrl.vehicle import load_vehicle
from benchmarks.real import DATA
from benchmarks.real.rov2016 import POINTS, Pointed

FOLDER, VEHICLE = "orca_bluerov2", "bluerov2"
LIKELY = POINTS  # probability from which a cause is an alarm
DIVES_PER_FALSE_ALARM = 1000.0  # as ``auv-diagnose`` has it
DEAD = re.compile(r"thruster (\d+) (?:gives nothing|pushes .*, whatever is commanded)")  # of what is said of one
MOST_S = 60.0  # of the processor for one dive


@dataclass(frozen=True)
class Held:
    """A log, and what is known of it by its owner, its parameters and its streams."""

    file: str  # in the data folder
    holds: str
    is_dive: bool
    doubt: str = ""  # what its own parameters say is wrong with it: part of a finding that is then borne


LOGS = {  # by day, in the order of time
    "2023-04-23": Held("ardusub_real/small.BIN", "no dive: armed for 8.8 s, no thruster turns", False),
    "2023-05-20": Held(
        f"{FOLDER}/2023_05_20_beckett__00000006.BIN.xz", "no dive: armed for 0.9 s at the surface", False
    ),
    "2023-08-26": Held(
        f"{FOLDER}/2023_08_26_kayak__00000003.BIN.xz", "no dive: thrusters turn for 28 s on a kayak", False
    ),
    "2023-10-18 first": Held(
        f"{FOLDER}/2023_10_18_mohai__00000009.BIN.xz", "a test of motor directions and a dive, thrusters turn for 45 s",
        True, "DIRECTION was set",
    ),
    "2023-10-18 second": Held(
        f"{FOLDER}/2023_10_18_mohai__00000014.BIN.xz", "a dive of 80 s, thrusters turn for 67 s", True
    ),
}  # fmt: skip
ALL = "all as dives"
LABELS = (*LOGS, ALL)
RESET = "2023-10-18 first"  # the log during which motor directions were set
REFERENCE = 4  # logs: the first three hold no dive


def missing(data: Path, label: str) -> str:
    """What a folder lacks for a row; empty: nothing."""
    needed = LOGS.values() if label == ALL else [LOGS[label]]
    absent = [held.file for held in needed if not (data / held.file).is_file()]
    return f"{data} lacks {', '.join(absent)}" if absent else ""


@contextmanager
def unpacked(data: Path, labels: Iterable[str]) -> Iterator[tuple[Path, ...]]:
    """The logs in a folder of their own, each by its name."""
    with TemporaryDirectory() as folder:
        paths = []
        for label in labels:
            source = data / LOGS[label].file
            content = source.read_bytes()
            paths.append(Path(folder) / source.name.removesuffix(".xz"))
            paths[-1].write_bytes(lzma.decompress(content) if source.suffix == ".xz" else content)
        yield tuple(paths)


def alarms_of(found: Diagnosis, doubt: str = "") -> tuple[str, ...]:
    """The faults that a diagnosis tells of, and doubts about the log, that neither notes nor parameters bear.

    That a thruster pushes otherwise is borne where the log itself says that the direction of its motor was set.
    """
    faults = [e.name for e in found.effects if e.probability >= LIKELY and not e.calibrates]
    unlike = told_of_one(found)
    one = re.match(r"thruster (\d+) ", unlike)
    is_borne = one is not None and any(f"MOT_{one[1]}_DIRECTION was set" in f.sentence for f in found.findings)
    unborne = [f.code for f in doubts(found.findings) if not (doubt and doubt in f.sentence)]
    return (*faults, *([unlike] if unlike and not is_borne else []), *unborne)


def told_of_one(found: Diagnosis) -> str:
    """What a diagnosis says of one thruster that does what no known effect does; else nothing."""
    told = found.verdict in (Verdict.UNEXPLAINED, Verdict.PARTLY_EXPLAINED)  # else nothing is said of where
    return does_otherwise(found.where) if told else ""


def dead_of(found: Diagnosis) -> tuple[str, ...]:
    """The thrusters that a diagnosis calls dead: by their gain, or as one that no command moves."""
    dead = [f"{number} ({share:.2f} of the others)" for number, share in Pointed.of(found).dead.items()]
    unmoved = DEAD.fullmatch(told_of_one(found))
    return (*dead, *([f"{unmoved[1]} (no command moves it)"] if unmoved else []))


def measure(data: Path, label: str) -> Mapping[str, Any]:
    """One row: what is said of a log, or of all of them."""
    return _follow(data) if label == ALL else _diagnose(data, label)


def _diagnose(data: Path, label: str) -> Mapping[str, Any]:
    held, begin = LOGS[label], time.process_time()
    vehicle = load_vehicle(VEHICLE)
    with unpacked(data, [label]) as (path,):
        try:
            log = read_flightlog(path, vehicle)
            found = diagnose(log, vehicle, vehicle_name=VEHICLE, uncertainty=load_uncertainty(VEHICLE, vehicle))
        except FlightLogError as refusal:
            right = not held.is_dive and "holds no dive" in str(refusal)
            return _row(label, held.holds, "refused", str(refusal), (), (), right, begin)
    dead, alarms = dead_of(found), alarms_of(found, held.doubt)
    silent = any(finding.code in ("nothing_moves", "held") for finding in found.findings)
    right = not dead and not alarms and silent is not held.is_dive
    return _row(label, held.holds, found.verdict.key, found.headline, dead, alarms, right, begin)


def _follow(data: Path) -> Mapping[str, Any]:
    begin, vehicle, alarms = time.process_time(), load_vehicle(VEHICLE), ()
    with unpacked(data, LOGS) as paths, TemporaryDirectory() as store:
        work = Work(
            vehicle, VEHICLE, load_settings(), tuple(load_uncertainty(VEHICLE, vehicle)), (), read_options(), False, {},
            Path(store), 1,
        )  # fmt: skip
        plan = DivePlan(paths, ("",) * len(paths), REFERENCE)
        name = paths[list(LOGS).index(RESET)].name
        try:
            baseline, dives = follow_all(work, plan, lambda step, share: None)
        except FlightLogError as refusal:
            said, day = str(refusal), str(refusal).partition(name)[2]
        else:
            alarms = tuple(f"dive {one.dive + 1}" for one in find_changes(dives, baseline, REFERENCE,
                                                                           DIVES_PER_FALSE_ALARM).alarms)  # fmt: skip
            said = f"{len(alarms)} alarms"
            day = " ".join(str(f) for dive in dives if dive.name == name for f in dive.findings)
    found = LOGS[RESET].doubt in day
    said += f"; the day on which directions were set is {'found' if found else 'not found'}"
    return _row(ALL, "one dive behind a reference that holds none", "", said, (), alarms, found and not alarms, begin)


def _row(
    label: str, holds: str, verdict: str, said: str, dead: tuple[str, ...], alarms: tuple[str, ...], right: bool,
    begin: float,
) -> Mapping[str, Any]:  # fmt: skip
    seconds = time.process_time() - begin
    cells = (
        label,
        holds,
        verdict,
        said,
        ", ".join(dead),
        ", ".join(alarms),
        "yes" if right else "no",
        f"{seconds:.0f}",
    )
    return {"row": tuple(cell.replace("|", "/") for cell in cells)}


def table(results: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    """Lines of Markdown, each as soon as its row is there, and what counts."""
    yield "| log | what it holds | verdict | said | called dead | alarm that nothing bears | right | CPU s |"
    yield "|---|---|---|---|---|---|---|---|"
    rows = []
    for result in results:
        rows.append(result["row"])
        yield f"| {' | '.join(rows[-1])} |"
    single = [row for row in rows if row[0] != ALL]
    slow = [row for row in single if float(row[-1]) > MOST_S]
    yield ""
    yield (
        f"{sum(row[-2] == 'yes' for row in rows)} of {len(rows)} right. In {sum(bool(row[4]) for row in single)} of "
        f"{len(single)} logs a thruster is called dead (must 0), in {sum(bool(row[5]) for row in single)} an alarm is "
        f"raised that nothing bears (must 1 at most), and {len(slow)} take more than {MOST_S:.0f} CPU s (must 0)."
    )


def main() -> None:
    """Diagnose what is there and print the table, line by line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--data", type=Path, default=DATA, help=f"folder with {FOLDER} and ardusub_real")
    data = parser.parse_args().data
    if lacks := missing(data, ALL):
        parser.error(lacks)
    for line in table(measure(data, label) for label in LABELS):
        print(line, flush=True)


if __name__ == "__main__":
    main()
