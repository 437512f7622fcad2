"""The interface for programs: dives, diagnoses, vehicles and events as JSON. ``/openapi.json`` describes it."""

import base64
import hashlib
import json
import re
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from auv_torchrl.extras import is_installed, library
from auv_torchrl.page import overview
from auv_torchrl.page.jobs import ABOUT_FILES, REPORT, JobError, files_of, request_job, vehicles
from auv_torchrl.page.store import Job, JobKind, JobState, LogEntry, LogState, Store
from auv_torchrl.page.upload import MOST_BYTES, receive, stored_name
from auv_torchrl.page.worker import Board, Worker
from auv_torchrl.text import printable

fastapi = library("fastapi", "the page needs", "page")
responses = library("fastapi.responses", "the page needs", "page")
Request = fastapi.Request

_BEAT_S = 15.0  # after which a watcher without news hears that the server is there
_SHOWN_ABOUT = ("format", "seconds", "begun", "firmware", "frame", "thrusters", "axes", "streams", "modes", "armed",
                "battery", "refused", "findings", "lines", "why")  # fmt: skip
_STYLE = re.compile(rb"<style>(.*?)</style>", re.S)


@dataclass
class LogChange:
    """What can be set of a dive."""

    healthy: bool | None = None
    vehicle: str | None = None


@dataclass
class JobRequest:
    """What to diagnose; ``log`` is short for one of ``logs``."""

    log: str = ""
    logs: list[str] = field(default_factory=list)
    healthy: list[str] | None = None  # those of the vehicle that are marked, where it is not given
    vehicle: str | None = None  # that of the first dive, where it is not given
    kind: JobKind = JobKind.DIAGNOSIS


def log_json(entry: LogEntry) -> dict[str, Any]:
    """A dive as programs get it."""
    about = {key: entry.about[key] for key in _SHOWN_ABOUT if key in entry.about}
    facts = {
        key: getattr(entry, key) for key in ("id", "bytes", "digest", "added", "state", "error", "vehicle", "healthy")
    }
    return {**facts, "name": printable(entry.name), "about": about}


def job_json(store: Store, job: Job) -> dict[str, Any]:
    """A diagnosis as programs get it."""
    return {**job.__dict__, "files": list(files_of(store, job)) if job.state.is_over else []}


# long: one route below the other
def routes(store: Store, worker: Worker, board: Board, most_bytes: int = MOST_BYTES) -> Any:
    """The routes of the interface."""
    router = fastapi.APIRouter()

    @router.post("/logs", status_code=201, summary="Drop one or many logs: a form with files, or one log with ?name=")
    async def post_logs(request: Request, name: str = "") -> Any:
        length = request.headers.get("content-length", "")
        uploads = await receive(
            request.stream(), request.headers.get("content-type", ""), int(length) if length.isdigit() else 0, name,
            store.folder / "incoming", most_bytes,
        )  # fmt: skip
        entries = [store.add_log(u.path, u.name, stored_name(u.name), u.size, u.digest)[0] for u in uploads]
        board.tell()
        if "text/html" in request.headers.get("accept", ""):
            return responses.RedirectResponse("./", 303)
        return {"logs": [log_json(entry) for entry in entries]}

    @router.get("/logs", summary="All dives")
    async def get_logs() -> dict[str, Any]:
        return {"logs": [log_json(entry) for entry in store.logs()]}

    @router.get("/logs/{id}", summary="One dive: what was read of it")
    async def get_log(id: str) -> dict[str, Any]:
        return log_json(store.log(id))

    @router.patch("/logs/{id}", summary="Mark a dive as healthy, or say which vehicle it was")
    async def patch_log(id: str, change: LogChange) -> dict[str, Any]:
        return log_json(change_log(store, board, id, change))

    @router.delete("/logs/{id}", status_code=204, summary="Delete a dive and its diagnoses")
    async def delete_log(id: str) -> None:
        remove_log(store, board, id)

    @router.get("/logs/{id}/overview", summary="Curves of a dive, thinned; from= and to= in s look closer")
    async def get_overview(id: str, begin: float | None = None, end: float | None = None) -> dict[str, Any]:
        return overview_of(store, store.log(id), None, begin, end)

    @router.post("/diagnoses", status_code=201, summary="Diagnose a dive (or kind=history, kind=calibration)")
    async def post_diagnosis(wanted: JobRequest) -> dict[str, Any]:
        logs = [*([wanted.log] if wanted.log else []), *wanted.logs]
        job = request_job(store, wanted.kind, logs, wanted.healthy, wanted.vehicle)
        board.tell()
        return job_json(store, job)

    @router.get("/diagnoses", summary="All diagnoses, those that wait included")
    async def get_diagnoses() -> dict[str, Any]:
        return {"diagnoses": [job_json(store, job) for job in store.jobs()]}

    @router.get("/diagnoses/{id}", summary="One diagnosis: how far it is, its verdict, its files")
    async def get_diagnosis(id: str) -> dict[str, Any]:
        return job_json(store, store.job(id))

    @router.delete("/diagnoses/{id}", summary="Cancel a diagnosis that waits or runs")
    async def delete_diagnosis(id: str) -> dict[str, Any]:
        job = store.job(id)
        if job.state.is_over:
            raise JobError(f"this diagnosis is {job.state} already", 409)
        return job_json(store, await worker.cancel(job))

    @router.get("/diagnoses/{id}/events", summary="How far it is, as server-sent events, until it is over")
    async def get_events(id: str) -> Any:
        store.job(id)

        async def lines() -> AsyncIterator[str]:
            while True:
                seen, job = board.version, store.job(id)
                yield f"event: {'end' if job.state.is_over else 'progress'}\ndata: {json.dumps(progress_of(job))}\n\n"
                if job.state.is_over:
                    return
                while board.version == seen:
                    await board.wait(_BEAT_S)
                    if board.version == seen:
                        yield ": still here\n\n"

        return responses.StreamingResponse(lines(), media_type="text/event-stream")

    @router.get("/diagnoses/{id}/overview", summary="Curves of its dive, with errors of prediction and findings")
    async def get_diagnosis_overview(id: str, begin: float | None = None, end: float | None = None) -> dict[str, Any]:
        job = store.job(id)
        if job.kind is not JobKind.DIAGNOSIS or len(job.logs) != 1:
            raise JobError("only the diagnosis of one dive has an overview", 404)
        return overview_of(store, store.log(job.logs[0]), job, begin, end)

    @router.get("/diagnoses/{id}/files", summary="What a diagnosis wrote")
    async def get_files(id: str) -> dict[str, Any]:
        found = files_of(store, store.job(id))
        return {
            "files": [{"name": name, "bytes": p.stat().st_size, "about": about_file(name)} for name, p in found.items()]
        }

    @router.get("/diagnoses/{id}/files/{name:path}", summary="One of these files")
    async def get_file(id: str, name: str) -> Any:
        path = files_of(store, store.job(id)).get(name)
        if path is None:
            raise fastapi.HTTPException(404, "there is no such file")
        return page_of(path) if path.suffix == ".html" else responses.FileResponse(
            path, media_type="application/octet-stream", filename=path.name
        )  # fmt: skip

    @router.get("/vehicles", summary="Vehicles to diagnose with, and how many dives each has")
    async def get_vehicles() -> dict[str, Any]:
        flown = [entry.vehicle for entry in store.logs()]
        return {"vehicles": [{**v.__dict__, "dives": flown.count(v.name)} for v in vehicles(store).values()]}

    @router.get("/vehicles/{name}", summary="The dives of a vehicle over time, with their verdicts")
    async def get_vehicle(name: str) -> dict[str, Any]:
        dives, histories = history_of(store, name)
        return {"name": name, "dives": dives, "histories": [job_json(store, job) for job in histories]}

    @router.get("/events", summary="What changes, as server-sent events")
    async def get_all_events() -> Any:
        async def lines() -> AsyncIterator[str]:
            async for kind in board.changes(_BEAT_S):
                running = [progress_of(job) for job in store.jobs() if job.state is JobState.RUNNING]
                yield f"event: {kind}\ndata: {json.dumps(running)}\n\n" if kind else ": still here\n\n"

        return responses.StreamingResponse(lines(), media_type="text/event-stream")

    return router


def progress_of(job: Job) -> dict[str, Any]:
    """How far a job is."""
    return {"id": job.id, "state": job.state, "share": job.share, "stage": job.stage, "verdict": job.verdict,
            "summary": job.summary, "error": job.error}  # fmt: skip


def about_file(name: str) -> str:
    """What a file is, for people."""
    return ABOUT_FILES.get(name, "a vehicle file: vehicle=FILE" if name.endswith("_calibrated.yaml") else "")


def change_log(store: Store, board: Board, id: str, change: LogChange) -> LogEntry:
    """Set what was given of a dive."""
    if change.vehicle and change.vehicle not in vehicles(store):
        raise JobError(f"there is no vehicle {change.vehicle!r}: there are {', '.join(vehicles(store))}")
    entry = store.log(id)
    if entry.state is not LogState.READY:
        raise JobError(f"{printable(entry.name)} is {entry.state}", 409)
    values = {key: value for key, value in change.__dict__.items() if value is not None}
    entry = store.change_log(id, **values) if values else entry
    board.tell()
    return entry


def remove_log(store: Store, board: Board, id: str) -> None:
    """Delete a dive with its diagnoses.

    Raises:
        JobError: while a job needs it.
    """
    store.log(id)
    using = [job for job in store.jobs() if id in (*job.logs, *job.healthy)]
    if any(not job.state.is_over for job in using):
        raise JobError("a diagnosis of this dive waits or runs: cancel it first", 409)
    for job in using:
        if job.logs == (id,):
            store.delete_job(job.id)
    store.delete_log(id)
    board.tell()


def history_of(store: Store, vehicle: str) -> tuple[list[dict[str, Any]], list[Job]]:
    """The dives of a vehicle in the order in which they were flown, each with its last diagnosis; and its histories."""
    jobs = store.jobs()
    dives = []
    for entry in sorted(store.logs(), key=lambda e: (e.about.get("begun") or e.added, e.added)):
        if entry.vehicle == vehicle and entry.state is LogState.READY:
            own = [job for job in jobs if job.kind is JobKind.DIAGNOSIS and job.logs == (entry.id,)]
            last = next((progress_of(job) for job in reversed(own) if job.state is not JobState.CANCELLED), None)
            dives.append({**log_json(entry), "diagnosis": last})
    return dives, [job for job in jobs if job.kind is not JobKind.DIAGNOSIS and job.vehicle == vehicle]


def overview_of(
    store: Store, entry: LogEntry, job: Job | None, begin: float | None, end: float | None
) -> dict[str, Any]:
    """The curves of a dive, and of its diagnosis: modes, findings and held-out stretches as spans of time."""
    path = store.folder_of(entry) / overview.FILE
    panels = overview.read_panels(path) if path.is_file() else []
    added = {int(number): value for number, value in entry.about.get("added", {}).items()}
    spans = [
        {
            "kind": finding["severity"],
            "from": finding["span"][0],
            "to": finding["span"][1],
            "label": finding["sentence"],
        }
        for finding in entry.about.get("findings", ())
        if finding.get("span")
    ]
    files = files_of(store, job) if job is not None else {}
    if "predictions.parquet" in files and is_installed("pyarrow"):
        errors, held_out = overview.prediction_panels(files["predictions.parquet"], added)
        panels = [*errors, *panels]
        spans += [{"kind": "held-out", "from": a, "to": b, "label": "held out: predicted"} for a, b in held_out]
    if "diagnosis.json" in files:
        spans += _onset(json.loads(files["diagnosis.json"].read_bytes()), added, entry.about.get("seconds", 0.0))
    modes = [{"from": a, "to": b, "name": name} for a, b, name in entry.about.get("modes", ())]
    return {"name": printable(entry.name), "modes": modes, "spans": spans, "panels": overview.drawn(panels, begin, end)}


def _onset(diagnosis: dict[str, Any], added: dict[int, float], seconds: float) -> list[dict[str, Any]]:
    """From when on the vehicle is changed."""
    where = diagnosis.get("where", {})
    inside, episode = where.get("onset_in_episode_s"), where.get("onset_episode")
    if inside is None or not added:
        return []
    begin = inside + (added[episode] if episode in added else next(iter(added.values())))
    return [{"kind": "error", "from": begin, "to": seconds, "label": "the vehicle is changed from here on"}]


def page_of(path: Path) -> Any:
    """A report that may show itself and do nothing: no script, no form, no request, whatever is in it."""
    content = path.read_bytes()
    own = _STYLE.search(content)
    digest = base64.b64encode(hashlib.sha256(own[1] if own else b"").digest()).decode()
    policy = (
        f"default-src 'none'; style-src 'sha256-{digest}'; img-src data:; base-uri 'none'; form-action 'none'; "
        "frame-ancestors 'self'; sandbox allow-same-origin"
    )
    return responses.HTMLResponse(content, headers={"content-security-policy": policy})


def report_name(job: Job, files: dict[str, Path]) -> str:
    """The page that a job wrote; empty where there is none."""
    return REPORT[job.kind] if REPORT[job.kind] in files else ""
