"""What ``docs/results/real.md`` holds: sections of measurements, each of which is made, and kept, by itself."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from benchmarks.real import ardusub, bluerov2, haizhe, orca, rov2016, saab

Result = Mapping[str, Any]  # of one measurement, of plain types


@dataclass(frozen=True)
class Section:
    """A table, with what is said before it."""

    name: str  # in the marks of the page
    part: str  # of the page, as the command line calls it
    title: str
    about: str
    command: str  # that prints this table alone
    labels: tuple[str, ...]  # of its measurements
    rows: frozenset[tuple[str, ...]]  # first cells that its table can have
    missing: Callable[[Path, str], str]  # what the data folder lacks for a measurement; empty: nothing
    measure: Callable[[Path, str], Result]
    lines: Callable[[Iterable[Result]], Iterator[str]]


@dataclass(frozen=True)
class Flights:
    """A table of flights: which, with which vehicle file, and whether sound ones are given with them."""

    cases: tuple[ardusub.Case, ...]
    vehicle: str = ardusub.VEHICLE
    healthy: bool = True
    folder: str = ardusub.FOLDER

    def case(self, label: str) -> ardusub.Case:
        """The case of this name."""
        return next(case for case in self.cases if case.name == label)

    def missing(self, data: Path, label: str) -> str:
        """Logs that the folder lacks."""
        return ardusub.absent(self.case(label), data / self.folder, self.healthy)

    def measure(self, data: Path, label: str) -> Result:
        """Diagnose one flight."""
        return {"row": ardusub.run(self.case(label), data / self.folder, self.vehicle, self.healthy).row}


def _flights(name: str, title: str, about: str, command: str, flights: Flights) -> Section:
    labels = tuple(case.name for case in flights.cases if case.has_healthy or not flights.healthy)
    rows = frozenset((label,) for label in labels)
    return Section(name, "ardusub", title, about, command, labels, rows, flights.missing, flights.measure, _of_rows)


def _of_rows(results: Iterable[Result]) -> Iterator[str]:
    return ardusub.table(result["row"] for result in results)


def _of_runs(results: Iterable[Result]) -> Iterator[str]:
    return bluerov2.table([bluerov2.Figures(**result) for result in results])


def _of_classes(results: Iterable[Result]) -> Iterator[str]:
    return haizhe.tables({result["seed"]: result["scored"] for result in results})


def _leave_out(data: Path, label: str) -> Result:
    flights = bluerov2.read_runs(data / "kth_bluerov2")
    tested = bluerov2.leave_out(label, flights)
    return {"test": tested.test, "before": tested.before, "after": tested.after}


def _no_runs(data: Path, label: str) -> str:
    try:
        bluerov2.check_runs(data / "kth_bluerov2")
    except FileNotFoundError as error:
        return str(error)
    return ""


def _classes(data: Path, label: str) -> Result:
    scored = haizhe.score(haizhe.read_classes(data / haizhe.FILE), load_settings(), int(label))
    return {"seed": int(label), "scored": [own.as_dict() for own in scored]}


def _no_classes(data: Path, label: str) -> str:
    return "" if (data / haizhe.FILE).is_file() else f"{data} lacks {haizhe.FILE}"


def measure(data: Path, piece: tuple[str, str]) -> Result:
    """Make one measurement, on one thread: section and label."""
    torch.set_num_threads(1)
    section = next(section for section in SECTIONS if section.name == piece[0])
    return section.measure(data, piece[1])


WRONG = "bluerov2_heavy"
_ARDUSUB = "python -m benchmarks.real.ardusub"

SECTIONS: Sequence[Section] = (
    Section(
        "bluerov2",
        "bluerov2",
        "bluerov2",
        (
            "A BlueROV2 Heavy in a tank with motion capture (von Benzon, KTH): two runs are diagnosed, each third "
            "one is predicted from its commands alone, from its first sample to its last, in m/s. "
            "[Run the benchmarks](../how-to/run-the-benchmarks.md#the-bluerov2-runs) says where to get the runs. "
            "Nobody knows what such a vehicle has; so nothing is called right or wrong, and what counts is the "
            "prediction. Run_12_09_45 is flown at commands of 0.625, and what it is predicted from was learnt at "
            "0.25, where gain and exponent of the thrust curve can hardly be told apart."
        ),
        "python -m benchmarks.real.bluerov2 FOLDER --folds",
        bluerov2.RUNS,
        frozenset((run, row) for run in bluerov2.RUNS for row in bluerov2.LABELS),
        _no_runs,
        _leave_out,
        _of_runs,
    ),
    _flights(
        "ardusub",
        "ardusub",
        (
            "Flights that ArduSub's firmware wrote of its own simulated vehicle, whose coefficients stand in "
            "`vehicle=ardusub_sitl`. No sound flight is given."
        ),
        _ARDUSUB,
        Flights(ardusub.CASES, healthy=False),
    ),
    _flights(
        "ardusub_healthy", "ardusub, with a sound flight", "The same, each beside another flight that was sound.",
        f"{_ARDUSUB} --healthy", Flights(ardusub.CASES),
    ),
    _flights(
        "ardusub_wrong_file",
        "ardusub, with a wrong file and a sound flight",
        (
            f"The same, started from `vehicle={WRONG}`, which is wrong about this vehicle by factors. The stock "
            "flights have no position sensor, and stand on the sea floor for most of their time. No motion tells how "
            "heavy a vehicle is, only how large its forces are beside its mass: of a file with 13.5 kg for 10.5 kg "
            "all forces come out larger, the buoyancy too. ArduSub's thrusters push as hard both ways: that one gets "
            "the opposite of its command (`thruster_swap`, -1) and that its gain is -1 are the same vehicle."
        ),
        f"{_ARDUSUB} --healthy --vehicle {WRONG}",
        Flights(ardusub.CASES, WRONG),
    ),
    _flights(
        "ardusub_altered",
        "ardusub, altered logs",
        (
            "The same again, of sound flights whose logs are as faulty vehicles would have written them: two "
            "commands exchanged in the log are two plugs exchanged on the vehicle."
        ),
        f"{_ARDUSUB} --altered --healthy --vehicle {WRONG}",
        Flights(ardusub.ALTERED, WRONG),
    ),
    _flights(
        "ardusub_vectored",
        "ardusub, six thrusters",
        (
            "Flights of the firmware's ordinary frame of six thrusters, started from `vehicle=bluerov2`, which is "
            "wrong about that vehicle by factors; both sound flights are given with a faulty one, and the other "
            "one with a sound one."
        ),
        f"{_ARDUSUB} --vectored --healthy --vehicle bluerov2",
        Flights(ardusub.VECTORED, "bluerov2", folder=ardusub.VECTORED_FOLDER),
    ),
    Section(
        "rov2016",
        "rov2016",
        "rov2016",
        (
            "A BlueROV of 2016 with six thrusters in a pool (master's thesis, Linköping; "
            "github.com/MrEkelund/ExjobbROV): attitude, rates, accelerations and outputs, no position and no speed. "
            "On the day of April the propeller of thruster 6 was broken. The vehicle's file is of published estimates "
            "that differ by factors of two (`benchmarks/real/rov2016.yaml`), no sound run is given, and each run is "
            "diagnosed by itself. *Called dead*: with a probability of one half or more, less than 0.3 of what the "
            "others give. *Right* is a run of April that points at thruster 6 and calls no other one dead. In May all "
            "thrusters work; there, *right* says no more than that none is pointed at or called dead, and no run says "
            "that all is well. The controller then moves thrusters 1, 2 and 5 together, and 3 and 4, but not 6. "
            "Test3_roll_pitch lasts 20 s: too few windows to show that a corrected file predicts better, and with the "
            "file as it is nothing is located."
        ),
        "python -m benchmarks.real.rov2016",
        tuple(rov2016.RUNS),
        frozenset((run,) for run in rov2016.RUNS),
        rov2016.missing,
        rov2016.measure,
        rov2016.table,
    ),
    Section(
        "orca",
        "orca",
        "orca",
        (
            "Five of the logs of one developer's BlueROV2 with six thrusters near Seattle, 2023 "
            "(github.com/clydemcqueen/orca4_1_tests, commit 2b9eadd6; the repository states no licence, so the logs "
            "are evaluated here and not redistributed): attitude, rates, accelerations, depth and outputs, no "
            "position and no speed. Three of the five hold no dive. Each log is diagnosed by itself, without a sound "
            "dive; the file is the published one (`vehicle=bluerov2`), a guess. Nobody measured this vehicle, and "
            "nobody knows its coefficients, its ballast on a day, or whether weed sat in a propeller; that the owner "
            "notes no fault is all that is known, and no figures are published. *Right*: a log without a dive is "
            "refused as such in one line, or said not to move; of a dive no thruster is called dead and no alarm is "
            "raised that neither notes nor parameters bear; that no cause is found is no error. *Called dead*: with a "
            "probability of one half or more, less than 0.3 of what the others give, or said to answer no command. On "
            "2023-10-18 the firmware's own test sets MOT_1, 2 and 4_DIRECTION to -1 in flight, so that one of these "
            "thrusters pushes otherwise than the file says is no alarm. The last row follows all logs as dives, with "
            "the first four as the reference; the default of three holds no dive at all. "
            "*Found* is what the answer names, be it as the reason of a refusal: with one dive in twelve months that "
            "can be used behind it, monitoring itself is not tried."
        ),
        "python -m benchmarks.real.orca",
        orca.LABELS,
        frozenset((label,) for label in orca.LABELS),
        orca.missing,
        orca.measure,
        orca.table,
    ),
    Section(
        "saab",
        "saab",
        "saab",
        (
            "A ROS 2 bag of a BlueROV2 Heavy in a tank with motion capture (SMaRC and Saab, 2025; "
            "github.com/SAABmarine-MEX/saabmarineMEX_learning, commit dda3f3d3; it states no licence, so the bag is "
            "evaluated here and not redistributed). Nothing moves, and its owners call it a trash bag. The bag "
            "carries no definitions of its messages, and holds odometry of another vehicle in the same tank, which "
            "comes 20 times as often as that of this one. *Right*: it is read, from this vehicle's topics, that "
            "nothing moves or no thruster turns is said first, and no fault is named. The bag lacks the parameters of "
            "the autopilot, which the program asks for: given are those of the frame as it is delivered. Nobody knows "
            "the directions of its motors, nor why it was armed; what the bag cannot show is whether a moving vehicle "
            "is diagnosed right."
        ),
        "python -m benchmarks.real.saab",
        (saab.RUN,),
        frozenset([(saab.RUN,)]),
        saab.missing,
        saab.measure,
        saab.table,
    ),
    Section(
        "haizhe",
        "haizhe",
        "haizhe",
        (
            "980 dives of ten seconds of a small vehicle with four vertical propellers, of which some carry a "
            "load, have a depth sensor that is off, or a cut propeller (Ji et al. 2021, CC BY 4.0; the training "
            "split, as Parquet with the columns `run` and `class`). All four propellers always get the same "
            "command. Labels choose the sound runs and score, nowhere else; that a spectrum tells a cut blade, "
            "and that how a run hangs at rest tells a load, was found by looking at labelled runs of this file. "
            "The first table is of seed 0; a seed says which fifth of the runs is set aside. A damage has no name "
            "of its own in the library: there, *right* means that the run is not called sound, and that neither "
            "load nor depth sensor is named."
        ),
        "python -m benchmarks.real.haizhe --seed 0",
        tuple(str(seed) for seed in haizhe.SEEDS),
        frozenset([*((name,) for name in haizhe.CLASSES), *((str(seed),) for seed in haizhe.SEEDS)]),
        _no_classes,
        _classes,
        _of_classes,
    ),
)  # fmt: skip
PARTS = tuple(dict.fromkeys(section.part for section in SECTIONS))
