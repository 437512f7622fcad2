"""Put every sealed log to the diagnosis, in parallel processes of one thread each; a killed run goes on."""

import json
import logging
import time
import traceback
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits
from tqdm import tqdm

from auv_torchrl.diagnosis import diagnose
from auv_torchrl.diagnosis.calibrate.parameters import load_uncertainty
from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.diagnosis.verdict import to_json
from auv_torchrl.flightlog import FlightLogError, read_flightlog
from auv_torchrl.parallel import each
from auv_torchrl.vehicle import load_vehicle
from benchmarks.blind.flights.sensor_sets import sensor_set
from benchmarks.blind.seal import log_path, read_manifest, write_json

log = logging.getLogger(__name__)


def examine(folder: Path, answers: Path, workers: int) -> None:
    """Write the answer to every case that has none yet to ``answers``; it sees the logs and the tasks alone."""
    answers.mkdir(exist_ok=True)
    tasks = read_manifest(folder)["tasks"]
    names = [name for name in tasks if not (answers / f"{name}.json").exists()]
    if len(names) < len(tasks):
        log.info("%d of %d logs were diagnosed before", len(tasks) - len(names), len(tasks))
    if not names:
        return
    answered = each(partial(examine_one, folder, answers), names, workers, in_order=False)
    for _ in tqdm(answered, total=len(names), desc="diagnosed", unit="log", disable=None):
        pass


def read_answers(folder: Path, answers: Path) -> dict[str, dict[str, Any]]:
    """The answer to every case: ``seconds`` and ``diagnosis`` as in ``diagnosis.json``, ``refused`` or ``error``."""
    return {name: json.loads((answers / f"{name}.json").read_text()) for name in read_manifest(folder)["tasks"]}


def examine_one(folder: Path, answers: Path, name: str) -> None:
    """Write the answer to one case to ``answers``."""
    manifest, settings = read_manifest(folder), load_settings()
    task, flown = manifest["tasks"][name], sensor_set(manifest["settings"].get("sensors")).vehicle
    if task["left_out"]:
        settings = replace(settings, ignored=(*settings.left_out, task["left_out"]))
    began, cpu = time.perf_counter(), time.process_time()
    answer: dict[str, Any] = {}
    try:
        vehicle = load_vehicle(flown)
        uncertainty = load_uncertainty(flown, vehicle) if manifest["settings"].get("is_guess") else ()
        flight_log = read_flightlog(log_path(folder, name), vehicle)
        healthy = [read_flightlog(log_path(folder, sound), vehicle) for sound in task["healthy"]]
        with threadpool_limits(1):
            diagnosis = diagnose(
                flight_log, vehicle, healthy, vehicle_name=flown, settings=settings, uncertainty=uncertainty
            )
        answer["diagnosis"] = to_json(diagnosis)
    except FlightLogError as error:
        answer["refused"] = str(error)
    except Exception as error:  # a diagnosis that fails is a wrong answer, and the report names it
        answer["error"] = f"{type(error).__name__}: {error}"
        log.warning("%s: %s", name, traceback.format_exc())
    answer["seconds"], answer["cpu_s"] = time.perf_counter() - began, time.process_time() - cpu
    write_json(answers / f"{name}.json", answer)
