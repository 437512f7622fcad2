"""``python -m benchmarks.trial.once FOLDER``: one dive of a vehicle through ArduSub's firmware, then the next one.

The firmware's own logs are FOLDER/dive_1.BIN and so on; it keeps its parameters from dive to dive, as on a vehicle.
``--set MOT_1_DIRECTION=-1`` sets one over MAVLink, ``--param advice.param`` what a diagnosis asks for. Sticks are drawn
from a seed, the same in each dive. ``--recorded`` takes dives that are recorded, and needs no firmware.
"""

import argparse
import logging
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from auv_torchrl.fly.known import scale_of
from auv_torchrl.link.plant import Plant, Start
from auv_torchrl.paths import PROJECT
from auv_torchrl.scenario import Scenario, read_scenario
from auv_torchrl.vehicle import CONTROLLED_INDEX, Vehicle, load_vehicle
from auv_torchrl.yaml_file import read_yaml
from benchmarks import show_progress
from benchmarks.trial import firmware
from benchmarks.trial.cases import FRAMES
from benchmarks.trial.dive import Diver, draw_sticks
from benchmarks.trial.recorded import EXCHANGE, Recorder, unpack
from benchmarks.trial.stack import Stack

log = logging.getLogger(__name__)
DIVE = "dive_{}.BIN"
SECONDS, DOWN_M = 40.0, 10.0
# Of the log, so that a recorded one is small: attitude, IMU and depth, outputs; one lane of the filter.
SMALL = {"LOG_BITMASK": 1154.0, "EK3_IMU_MASK": 1.0}


def scenario_named(name: str | None, vehicle: Vehicle) -> Scenario:
    """A scenario of ``conf/scenario``; None for a healthy vehicle."""
    if name is None:
        return Scenario("healthy")
    return read_scenario(name, read_yaml(PROJECT / "conf" / "scenario" / f"{name}.yaml", "scenario"), vehicle)


def fly(
    vehicle_name: str, scenario: str | None, set_first: Mapping[str, float], path: Path, seed: int, record: bool
) -> None:
    """Fly a dive for the log at ``path``; beside it the exchange, where that is to be recorded."""
    vehicle, frame = load_vehicle(vehicle_name), next(n for n, name in FRAMES.items() if name == vehicle_name)
    plant = Plant(vehicle, scenario_named(scenario, vehicle), Start(down=DOWN_M, held=True))
    recorder = Recorder() if record else None
    stack = Stack(plant, path.parent / "ardusub", {"FRAME_CONFIG": frame, **SMALL}, recorder=recorder)
    try:
        diver = Diver(stack)
        diver.begin(plant.start.let_down_s)
        if set_first:
            diver.set(set_first)
        mixer = vehicle.mixer[:, list(CONTROLLED_INDEX)].tolist()
        diver.fly(draw_sticks(np.random.default_rng(seed), SECONDS, frame), scale_of(frame, mixer))
    finally:
        stack.close()
    shutil.copy(stack.firmware.logs()[-1], path)
    if recorder is not None:
        recorder.write(path.with_name(EXCHANGE))


def read_parameters(path: Path) -> dict[str, float]:
    """What a file of a ground station sets.

    Raises:
        ValueError: for a line that sets nothing.
    """
    found = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        name, comma, value = line.partition(",")
        if not comma:
            raise ValueError(f"{path}: {line!r} is no NAME,VALUE: give the advice.param of a diagnosis")
        found[name.strip()] = float(value)
    return found


def read_setting(text: str) -> tuple[str, float]:
    """``MOT_1_DIRECTION=-1``."""
    name, _, value = text.partition("=")
    return name, float(value)


def main() -> None:
    """Fly, or unpack."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("folder", type=Path, help="of the vehicle: its firmware's parameters, and its logs")
    parser.add_argument("--vehicle", default="bluerov2_heavy", choices=sorted(FRAMES.values()))
    parser.add_argument("--scenario", help="of conf/scenario; none for a healthy vehicle")
    parser.add_argument("--set", type=read_setting, nargs="*", default=[], help="NAME=VALUE, set before the dive")
    parser.add_argument("--param", type=Path, help="advice.param of a diagnosis, which is set before the dive")
    parser.add_argument("--seed", type=int, default=0, help="of the sticks")
    parser.add_argument("--recorded", action="store_true", help="the log of this dive as it is recorded")
    parser.add_argument("--record", action="store_true", help="keep what firmware and physics said to each other")
    options = parser.parse_args()
    show_progress()
    try:
        set_first = dict(options.set) | (read_parameters(options.param) if options.param else {})
        options.folder.mkdir(parents=True, exist_ok=True)
        number = 1 + sum(1 for _ in options.folder.glob(DIVE.format("*")))
        path = options.folder / DIVE.format(number)
        if options.recorded:
            unpack(options.vehicle, options.scenario, set_first, path)
        else:
            firmware.program()
            fly(options.vehicle, options.scenario, set_first, path, options.seed, options.record)
    except (ValueError, OSError) as error:
        parser.error(str(error))
    sys.stdout.write(f"{path}\n")


if __name__ == "__main__":
    main()
