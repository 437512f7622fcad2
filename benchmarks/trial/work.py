"""One case from beginning to end; each piece is kept as soon as it is there, and a killed run goes on behind it."""

import json
import logging
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from auv_torchrl.diagnosis import Diagnosis, diagnose
from auv_torchrl.diagnosis.calibrate.parameters import load_uncertainty
from auv_torchrl.diagnosis.verdict import to_json
from auv_torchrl.files import write_whole
from auv_torchrl.flightlog import FlightLogError, read_flightlog
from auv_torchrl.fly.known import scale_of
from auv_torchrl.link.plant import Start
from auv_torchrl.scenario import Scenario, read_scenario
from auv_torchrl.vehicle import CONTROLLED_INDEX, load_vehicle
from benchmarks.scoring import Score, fault, score_diagnosis, sound
from benchmarks.trial import motor_detection
from benchmarks.trial.cases import FRAMES, HEALTHY_DIVES, Case, Effects, Wired, built, of_the_day
from benchmarks.trial.dive import Diver, Refused, draw_sticks
from benchmarks.trial.remedy import mended, remedy_of, still_mirrored
from benchmarks.trial.stack import FirmwareEnded, Stack

log = logging.getLogger(__name__)

DIVE_S = 90.0
DOWN_M = 20.0  # where the vehicle is let go: one that cannot dive rises, and ArduSub's depth ends at the surface
_RESULT = "result.json"

Result = dict[str, Any]


@dataclass(frozen=True)
class Dive:
    """One dive to be flown."""

    frame: int
    number: int  # of the day and of the pilot, from 1; the repeated dive has that of the first one
    effects: Effects
    parameters: Mapping[str, float]  # of a firmware that is new
    set_first: Mapping[str, float]  # over MAVLink, before it
    mirrored: tuple[int, ...] = ()  # thrusters


def simulate(dive: Dive, folder: Path, seed: int) -> Stack:
    """Firmware and vehicle, ready to fly."""
    vehicle = of_the_day(built(dive.frame, seed), seed, dive.frame, dive.number)
    scenario = read_scenario("case", {"effects": dive.effects}, vehicle) if dive.effects else Scenario("healthy")
    plant = Wired(dive.mirrored, vehicle, scenario, Start(down=DOWN_M, held=True))
    return Stack(plant, folder, {"FRAME_CONFIG": dive.frame, **dive.parameters})


def fly(dive: Dive, folder: Path, log_path: Path, seed: int) -> Result:
    """Fly a dive and keep the log of the firmware; what became of it."""
    begun, stack = time.process_time(), simulate(dive, folder, seed)
    mixer = load_vehicle(FRAMES[dive.frame]).mixer[:, list(CONTROLLED_INDEX)].tolist()
    sticks = draw_sticks(np.random.default_rng((seed, dive.frame, 4, dive.number)), DIVE_S, dive.frame)
    refused = None
    try:
        diver = Diver(stack)
        diver.begin(stack.plant.start.let_down_s)
        if dive.set_first:
            diver.set(dive.set_first)
        diver.fly(sticks, scale_of(dive.frame, mixer))
    except (Refused, FirmwareEnded) as error:
        refused = str(error)
    finally:
        stack.close()
    if stack.firmware.logs():
        shutil.copy(stack.firmware.logs()[-1], log_path)
    flown_s = stack.now()
    return {"refused": refused, "simulated_s": flown_s, "cpu_s": time.process_time() - begun}


def detected(case: Case, folder: Path, seed: int) -> Result:
    """What ArduSub's own motor detection says about the vehicle."""
    shutil.rmtree(folder, ignore_errors=True)
    dive = Dive(case.frame, HEALTHY_DIVES + case.number, case.effects, case.parameters, {}, case.mirrored)
    stack = simulate(dive, folder, seed)
    try:
        diver = Diver(stack)
        diver.begin(stack.plant.start.let_down_s)
        found = motor_detection.detect(diver)
        return {"said": found.said, "names": found.names(case), "texts": diver.texts}
    except (Refused, FirmwareEnded) as error:
        return {"said": f"refused: {error}", "names": False, "texts": []}
    finally:
        stack.close()


def answer(log_path: Path, healthy: Sequence[Path], vehicle_name: str) -> tuple[Diagnosis, float]:
    """The diagnosis of a log with the healthy dives, and its processor time."""
    begun, vehicle = time.process_time(), load_vehicle(vehicle_name)
    found = diagnose(
        read_flightlog(log_path, vehicle),
        vehicle,
        [read_flightlog(path, vehicle) for path in healthy],
        vehicle_name=vehicle_name,
        uncertainty=load_uncertainty(vehicle_name, vehicle),
    )
    return found, time.process_time() - begun


def judged(log_path: Path, healthy: Sequence[Path], case: Case) -> Result:
    """What the diagnosis says about a dive, how right that is, and what is to be done."""
    if not log_path.exists():
        return {"verdict": "not flown", "named": "", "score": Score.WRONG.name, "cpu_s": 0.0}
    try:
        found, seconds = answer(log_path, healthy, case.vehicle)
    except FlightLogError as error:
        return {"verdict": "refused", "said": str(error), "named": "", "score": Score.WRONG.name, "cpu_s": 0.0}
    except Exception:  # a crash is a wrong answer of this case, and the others are to be flown all the same
        log.exception("%s", log_path)
        return {"verdict": "crashed", "named": "", "score": Score.WRONG.name, "cpu_s": 0.0}
    content, vehicle = to_json(found), load_vehicle(case.vehicle)
    truth = fault(case.truth) if case.truth else sound()
    remedy = remedy_of(found)
    write_whole(log_path.with_suffix(".diagnosis.json"), (json.dumps(content, indent=2) + "\n").encode())
    return {
        "verdict": found.verdict.key,
        "named": "; ".join(_named(effect) for effect in found.effects if effect.is_likely and not effect.calibrates),
        "score": score_diagnosis(content, truth, vehicle).name,
        "cpu_s": seconds,
        "remedy": {"parameters": dict(remedy.parameters), "said": remedy.said,
                   "left": mended(case.effects, remedy), "mirrored": still_mirrored(case.mirrored, remedy)},
    }  # fmt: skip


def _named(effect: Any) -> str:
    values = ", ".join(f"{name} {own.value:.2f}" for name, own in effect.parameters.items() if not own.is_nominal)
    return f"{effect.name} {values} (p {effect.probability:.2f})"


def healthy_dives(frame: int, folder: Path, seed: int) -> list[Path]:
    """The logs of the healthy dives of a frame, flown if they are not there.

    Raises:
        Refused: where the firmware did not fly them.
    """
    paths = []
    for number in range(1, HEALTHY_DIVES + 1):
        path = folder / f"healthy_{frame}_{number}.BIN"
        flown = _kept(path.with_suffix(".flown.json"), lambda path=path, number=number: fly(
            Dive(frame, number, {}, {}, {}), _fresh(folder / f"healthy_{frame}_{number}"), path, seed))  # fmt: skip
        if flown["refused"]:
            raise Refused(f"healthy dive {number} on frame {frame}: {flown['refused']}")
        paths.append(path)
    return paths


def is_done(case: Case, folder: Path) -> bool:
    """Whether nothing of a case is left to do."""
    return (folder / case.name / _RESULT).exists()


def run(case: Case, folder: Path, seed: int, aside: Executor) -> Result:
    """All of one case: flown, diagnosed ``aside``, mended, flown again; and ArduSub's own detection."""
    healthy = healthy_dives(case.frame, folder, seed)
    own = folder / case.name
    number = HEALTHY_DIVES + case.number
    own.mkdir(parents=True, exist_ok=True)
    first, again = own / "dive.BIN", own / "repeated.BIN"
    flown = _kept(own / "flown.json", lambda: fly(
        Dive(case.frame, number, case.effects, case.parameters, {}, case.mirrored), _fresh(own / "ardusub"), first,
        seed))  # fmt: skip
    said = _kept(own / "diagnosed.json", lambda: aside.submit(judged, first, healthy, case).result())
    result = {"flown": flown, "diagnosed": said, "repeated": None}
    remedy = said.get("remedy")
    if case.truth and remedy and remedy["said"]:
        wires = tuple(remedy["mirrored"])
        mended_one = Dive(case.frame, number, remedy["left"], {}, remedy["parameters"], wires)
        refly = _kept(own / "reflown.json", lambda: fly(mended_one, own / "ardusub", again, seed))
        answered = _kept(own / "repeated.json", lambda: aside.submit(judged, again, healthy, case).result())
        result["repeated"] = {**refly, **answered}
    result["detected"] = _kept(own / "detected.json", lambda: detected(case, own / "detect", seed))
    write_whole(own / _RESULT, (json.dumps(result, indent=2) + "\n").encode())
    return result


def _fresh(folder: Path) -> Path:
    shutil.rmtree(folder, ignore_errors=True)
    return folder


def _kept(path: Path, measure: Callable[[], Result]) -> Result:
    """What a file keeps; measured and written where it is not there."""
    if path.exists():
        return json.loads(path.read_text())
    log.info("%s", path)
    result = measure()
    write_whole(path, (json.dumps(result, indent=2) + "\n").encode())
    return result
