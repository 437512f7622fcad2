"""``python -m benchmarks.real`` (``make real``): real vehicles and firmware, as far as their logs are at hand.

Prints Markdown, section by section as they come; ``--publish`` writes it to ``docs/real.md`` instead. Logs are looked
for in the folder that ``AUV_TORCHRL_DATA`` names, else in ``../shared/data``; what is absent is named.
"""

import argparse
import logging
from collections.abc import Callable, Iterator
from pathlib import Path

import torch

from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.files import write_whole
from auv_torchrl.paths import PROJECT
from benchmarks import show_progress
from benchmarks.real import DATA, ardusub, bluerov2, haizhe

log = logging.getLogger(__name__)
PAGE = PROJECT / "docs" / "real.md"
HEAD = """# Real vehicles and firmware

`make real` writes this page (`python -m benchmarks.real --publish`). Where the logs come from, and what is known about
them, stands at the head of each section; what fails is told in [diagnosis.md](diagnosis.md).
"""
ABOUT = {
    "bluerov2": """\
A BlueROV2 Heavy in a tank with motion capture (von Benzon, KTH): two runs are diagnosed, each third one is
predicted from its commands alone, from its first sample to its last, in m/s. `python -m benchmarks.real.bluerov2 FOLDER
--folds`; [diagnosis.md](diagnosis.md#a-real-vehicle) says where to get the runs.""",
    "ardusub": """\
Flights that ArduSub's firmware wrote of its own simulated vehicle, whose coefficients stand in
`vehicle=ardusub_sitl`: alone, with another sound flight, and with a vehicle file that is wrong about it
(`bluerov2_heavy`), with which sound flights are also diagnosed as faulty vehicles would have logged them: two commands
exchanged in the log are two plugs exchanged on the vehicle. `python -m benchmarks.real.ardusub [--healthy]
[--vehicle bluerov2_heavy] [--altered]`.""",
    "haizhe": """\
980 dives of ten seconds of a small vehicle with four vertical propellers, of which some carry a load, have a
depth sensor that is off, or a cut propeller (Ji et al. 2021, CC BY 4.0; the training split, as Parquet with the columns
`run` and `class`). All four propellers always get the same command. `python -m benchmarks.real.haizhe --seed 0`.""",
}


def of_bluerov2(data: Path) -> Iterator[str]:
    """Every run predicted once."""
    flights = bluerov2.read_runs(data / "kth_bluerov2")
    yield from bluerov2.table([bluerov2.leave_out(test, flights) for test in bluerov2.RUNS])


def of_ardusub(data: Path) -> Iterator[str]:
    """Alone, with healthy flights, and with a file that is wrong."""
    for vehicle, healthy, known in (
        (ardusub.VEHICLE, False, ardusub.CASES),
        (ardusub.VEHICLE, True, ardusub.CASES),
        ("bluerov2_heavy", True, ardusub.CASES),
        ("bluerov2_heavy", True, ardusub.ALTERED),
    ):
        cases = ardusub.find_cases(data, (), healthy, known)
        altered = ", sound flights with altered logs" if known is ardusub.ALTERED else ""
        yield f"`vehicle={vehicle}`{', each with a sound flight' if healthy else ''}{altered}:"
        yield ""
        yield from ardusub.table(ardusub.run(case, data / ardusub.FOLDER, vehicle, healthy) for case in cases)
        yield ""


def of_haizhe(data: Path) -> Iterator[str]:
    """A fifth of all runs."""
    path = data / haizhe.FILE
    if not path.is_file():
        raise FileNotFoundError(f"{data} lacks {haizhe.FILE}")
    yield from haizhe.table(haizhe.score(haizhe.read_classes(path), load_settings(), seed=0))


PARTS: dict[str, Callable[[Path], Iterator[str]]] = {
    "bluerov2": of_bluerov2,
    "ardusub": of_ardusub,
    "haizhe": of_haizhe,
}


def sections(data: Path, names: list[str]) -> Iterator[str]:
    """Lines of the page, each as soon as it is known."""
    yield HEAD
    for name in names:
        yield f"## {name}\n\n{ABOUT[name]}\n"
        try:
            yield from PARTS[name](data)
            yield ""
        except FileNotFoundError as error:
            log.warning("%s is left out: %s", name, error)
            yield f"Not measured: {error}.\n"


def main() -> None:
    """Measure and print, or write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("parts", nargs="*", help=f"of {', '.join(PARTS)}; all if not given")
    parser.add_argument("--data", type=Path, default=DATA, help="folder with kth_bluerov2, ardusub_sitl, haizhe")
    parser.add_argument("--publish", action="store_true", help=f"write {PAGE.relative_to(PROJECT)}, with all parts")
    options = parser.parse_args()
    if unknown := set(options.parts) - set(PARTS):
        parser.error(f"no part named {', '.join(sorted(unknown))}: give some of {', '.join(PARTS)}")
    if options.publish and options.parts:
        parser.error("--publish writes all parts: leave their names out")
    show_progress()
    torch.set_num_threads(1)
    page = []
    for line in sections(options.data, options.parts or list(PARTS)):
        page.append(line)
        if not options.publish:
            print(line, flush=True)
    if options.publish:
        write_whole(PAGE, "\n".join(page).encode())


if __name__ == "__main__":
    main()
