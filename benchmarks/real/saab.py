"""``python -m benchmarks.real.saab``: a ROS 2 bag of a BlueROV2 Heavy in which nothing moves; what is read and said?

A tank with motion capture (SMaRC and Saab, github.com/SAABmarine-MEX/saabmarineMEX_learning). The bag carries no
definitions of its messages, and has odometry of another vehicle, which comes more often than that of this one.
"""

import argparse
import lzma
import shutil
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from auv_torchrl.diagnosis import diagnose
from auv_torchrl.diagnosis.calibrate.parameters import load_uncertainty
from auv_torchrl.flightlog import FlightLogError, read_flightlog
from auv_torchrl.flightlog.readers import read_streams
from auv_torchrl.flightlog.streams.options import read_options
from auv_torchrl.vehicle import load_vehicle
from benchmarks.real import DATA

FOLDER, VEHICLE = "saab_brov", "bluerov2_heavy"
RUN = "rosbag2_2025_05_14-15_59_00"
OTHERS = ("sam", "hula")  # in names of topics: another vehicle and an object in the same tank
MOTORS = range(1, 9)
PARAMETERS = {  # that the bag lacks: those of the frame as it is delivered. The owners' directions are not known
    "FRAME_CONFIG": 2, "MOT_PWM_MIN": 1100, "MOT_PWM_MAX": 1900,
    **{f"SERVO{n}_FUNCTION": 32 + n for n in MOTORS},
    **{f"MOT_{n}_DIRECTION": 1 for n in MOTORS},
}  # fmt: skip
SAYS_FIRST = ("no thruster turns", "does not move")  # of a bag in which nothing moves


def missing(data: Path, label: str) -> str:
    """What a folder lacks for a bag; empty: nothing."""
    folder = data / FOLDER / label
    return "" if any(folder.glob("metadata.yaml*")) else f"{data / FOLDER} lacks {label}"


def unpack(bag: Path, folder: Path) -> Path:
    """The bag in a folder of its own, with its files unpacked."""
    own = folder / bag.name
    own.mkdir()
    for file in sorted(bag.iterdir()):
        if file.suffix == ".xz":
            (own / file.stem).write_bytes(lzma.decompress(file.read_bytes()))
        else:
            shutil.copy(file, own)
    return own


def measure(data: Path, label: str) -> Mapping[str, Any]:
    """Read and diagnose a bag; the cells of its line in the table."""
    begin, vehicle, named = time.process_time(), load_vehicle(VEHICLE), ()
    with TemporaryDirectory() as folder:
        path = unpack(data / FOLDER / label, Path(folder))
        read = read_streams(path)
        streams = read.streams if read else {}
        sources = {name: streams[name].source if name in streams else "" for name in ("outputs", "position", "gyro")}
        try:
            log = read_flightlog(path, vehicle, options=read_options(params=PARAMETERS))
            found = diagnose(log, vehicle, vehicle_name=VEHICLE, uncertainty=load_uncertainty(VEHICLE, vehicle))
        except FlightLogError as refusal:
            said = str(refusal)
        else:
            said = found.headline
            named = tuple(effect.name for effect in found.effects if not effect.calibrates)
    seconds = time.process_time() - begin
    right = is_right(sources, said, named)
    topics = [source or "not read" for source in sources.values()]
    return {
        "row": (label, *topics, said.replace("|", "/"), ", ".join(named), "yes" if right else "no", f"{seconds:.0f}")
    }


def is_right(sources: Mapping[str, str], said: str, named: Iterable[str]) -> bool:
    """Whether all was read from this vehicle's topics, that nothing moves is said first, and no fault is named."""
    own = all(source and not any(name in source for name in OTHERS) for source in sources.values())
    return own and any(clause in said for clause in SAYS_FIRST) and not any(named)


def table(results: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    """Lines of Markdown, each as soon as its row is there."""
    yield "| bag | commands from | position from | rates from | said | named | right | CPU s |"
    yield "|---|---|---|---|---|---|---|---|"
    for result in results:
        yield f"| {' | '.join(result['row'])} |"


def main() -> None:
    """Read and diagnose the bag and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--data", type=Path, default=DATA, help=f"folder with {FOLDER}/{RUN}")
    data = parser.parse_args().data
    if lacks := missing(data, RUN):
        parser.error(lacks)
    for line in table([measure(data, RUN)]):
        print(line)


if __name__ == "__main__":
    main()
