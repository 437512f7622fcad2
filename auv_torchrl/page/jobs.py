"""What each kind of job runs, what a request of one needs, and which files it leaves."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from auv_torchrl.page.refusal import Refusal
from auv_torchrl.page.store import Job, JobKind, JobState, LogEntry, LogState, Store
from auv_torchrl.paths import config_names
from auv_torchrl.quantities import counted

DIAGNOSE, CALIBRATE = "auv_torchrl.monitoring.command", "auv_torchrl.diagnosis.command.calibrate"
REPORT = {JobKind.DIAGNOSIS: "report.html", JobKind.HISTORY: "dives.html", JobKind.CALIBRATION: ""}
CALIBRATED = "calibrated_"  # how vehicles are called that a calibration made; its job follows
MOST_WAITING = 100  # jobs
_ONE_DIAGNOSIS, _LEAST_HISTORY = 1, 2  # dives that a diagnosis and a history need
ABOUT_FILES: Mapping[str, str] = {
    "report.html": "the report, a page that needs nothing else",
    "dives.html": "the report over all dives",
    "advice.param": "parameters to set; ground stations load it",
    "scenario.yaml": "what was found, to simulate: train.py diagnosis=...",
    "randomization.yaml": "what was found, with its uncertainty, to train over",
    "diagnosis.json": "the same in numbers",
    "dives.json": "the same in numbers",
    "diagnosis.rrd": "the recording: rerun diagnosis.rrd",
    "predictions.parquet": "measured, before and after, sample by sample",
    "next_experiment.csv": "commands to fly next",
    "output.txt": "what the command printed",
}


class JobError(Refusal):
    """A job that cannot be asked for."""

    usual = 422


@dataclass(frozen=True)
class VehicleChoice:
    """A vehicle that dives can be diagnosed with."""

    name: str
    title: str
    file: str  # below the folder of the page; empty for one of the package


def vehicles(store: Store) -> dict[str, VehicleChoice]:
    """By name, the vehicles of the package and of a folder of one's own, and those that were calibrated here."""
    found = {name: VehicleChoice(name, name, "") for name in config_names("vehicle")}
    for job in store.jobs():
        if job.kind is JobKind.CALIBRATION and job.state is JobState.DONE:
            name = f"{CALIBRATED}{job.id}"
            title = f"{_base(job.vehicle, store)}, calibrated on {counted(len(job.healthy), 'dive')}, {job.ended[:10]}"
            found[name] = VehicleChoice(name, title, _calibrated_file(job))
    return found


def _base(vehicle: str, store: Store) -> str:
    return (
        vehicle
        if not vehicle.startswith(CALIBRATED)
        else _base(store.job(vehicle.removeprefix(CALIBRATED)).vehicle, store)
    )


def _calibrated_file(job: Job) -> str:
    base = job.vehicle if not job.vehicle.startswith(CALIBRATED) else "vehicle"
    return f"jobs/{job.id}/{re.sub(r'[^A-Za-z0-9_-]', '_', base)}_calibrated.yaml"


def request_job(
    store: Store, kind: JobKind, logs: Iterable[str], healthy: Iterable[str] | None = None, vehicle: str | None = None
) -> Job:
    """Put a job into the queue.

    Args:
        store: of the page.
        kind: what to do.
        logs: dives to diagnose or to follow, by id; of a calibration none.
        healthy: healthy dives, by id; those of this vehicle that are marked where it is None.
        vehicle: its name; that of the first dive where it is None.

    Raises:
        JobError: if it cannot be done, naming why.
        NoEntry: for a log that there is not.
    """
    if sum(job.state is JobState.WAITING for job in store.jobs()) >= MOST_WAITING:
        raise JobError(f"{MOST_WAITING} jobs wait already: cancel some, or wait", 429)
    entries = [store.log(id) for id in dict.fromkeys(logs)]
    named = [store.log(id) for id in dict.fromkeys(healthy or ())]
    vehicle = vehicle or next((entry.vehicle for entry in [*entries, *named] if entry.vehicle), "")
    if not vehicle:
        raise JobError("nothing says which vehicle this was: choose one")
    if vehicle not in vehicles(store):
        raise JobError(f"there is no vehicle {vehicle!r}: there are {', '.join(vehicles(store))}")
    if healthy is None:
        named = [entry for entry in store.logs() if entry.healthy and entry.vehicle == vehicle]
    if kind is not JobKind.CALIBRATION:
        named = [entry for entry in named if kind is JobKind.HISTORY or entry.id not in {e.id for e in entries}]
    _check_number(kind, entries, named)
    for entry in [*entries, *named]:
        if entry.state is not LogState.READY:
            raise JobError(
                f"{entry.name} is not read yet" if entry.state is LogState.WAITING else f"{entry.name} cannot be read"
            )
        if entry.about.get("refused"):
            raise JobError(f"{entry.name} cannot be diagnosed: {entry.about['refused']}")
    return store.add_job(kind, vehicle, [e.id for e in entries], [e.id for e in named])


def _check_number(kind: JobKind, logs: list[LogEntry], healthy: list[LogEntry]) -> None:
    if kind is JobKind.DIAGNOSIS and len(logs) < _ONE_DIAGNOSIS:
        raise JobError("choose a dive")
    if kind is JobKind.HISTORY and (not healthy or len({e.id for e in [*logs, *healthy]}) < _LEAST_HISTORY):
        raise JobError("a history needs a dive that is marked healthy, and a later one")
    if kind is JobKind.HISTORY and not {e.id for e in logs} - {e.id for e in healthy}:
        raise JobError("all these dives are marked healthy: a history needs one that is not")
    if kind is JobKind.CALIBRATION and not healthy:
        raise JobError("a calibration needs dives that are marked healthy")


def command_of(store: Store, job: Job) -> tuple[str, list[str]]:
    """The module of a job's command, and its arguments; paths are below the folder of the page."""
    chosen = vehicles(store)[job.vehicle]
    vehicle = f"vehicle={chosen.file or chosen.name}"
    healthy = f"healthy=[{','.join(_path(store, id) for id in job.healthy)}]"
    output = f"jobs/{job.id}"
    if job.kind is JobKind.CALIBRATION:
        return CALIBRATE, [healthy, vehicle, f"output={_calibrated_file(job)}", "replace=true"]
    log = f"log=[{','.join(_path(store, id) for id in job.logs)}]"
    if job.kind is JobKind.HISTORY:
        return DIAGNOSE, [log, healthy, vehicle, "dives=true", "jobs=1", "store=dives", f"output={output}/result"]
    return DIAGNOSE, [log, healthy, vehicle, f"output={output}/result"]


def _path(store: Store, id: str) -> str:
    entry = store.log(id)
    return f"logs/{entry.id}/upload/{entry.file}"


def files_of(store: Store, job: Job) -> dict[str, Path]:
    """What a job left, by its name relative to the folder of its results; nothing else is ever handed out."""
    folder = store.folder_of(job)
    places = [(folder / "result", True), (folder, False)]
    found: dict[str, Path] = {}
    for place, deep in places:
        for path in sorted(place.rglob("*") if deep else place.glob("*")):
            if path.is_file() and not path.is_symlink() and not path.name.startswith("."):
                found[path.relative_to(place).as_posix()] = path
    return found
