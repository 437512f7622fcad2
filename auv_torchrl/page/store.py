"""What the page remembers: dives and jobs, in one SQLite file of a folder that also has their files.

``logs/<id>/upload/<name>`` is a log as it came, ``logs/<id>/`` also has what was read of it, and ``jobs/<id>/`` what a
job wrote. Everything is called from the one thread of the server.
"""

import json
import secrets
import shutil
import sqlite3
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Any

from auv_torchrl.page.refusal import Refusal

_SCHEMA = """
create table if not exists logs (
    id text primary key, name text, file text, bytes integer, digest text unique, added text, state text, error text,
    vehicle text, healthy integer default 0, about text);
create table if not exists jobs (
    id text primary key, kind text, vehicle text, logs text, healthy text, state text, share real, stage text,
    error text, queued text, begun text, ended text, verdict text, summary text);
create table if not exists facts (name text primary key, value text);
"""
_ID_BYTES = 8  # of a random name: nobody guesses it, and none comes twice


class NoEntry(Refusal, LookupError):
    """There is no log or job of that name."""

    usual = 404


class LogState(StrEnum):
    """How far a log is."""

    WAITING = "waiting"  # to be read
    READY = "ready"
    REFUSED = "refused"  # nothing of it can be used; its file is deleted


class JobState(StrEnum):
    """How far a job is."""

    WAITING = "waiting"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"

    @property
    def is_over(self) -> bool:
        """Whether nothing will change any more."""
        return self not in (JobState.WAITING, JobState.RUNNING)


class JobKind(StrEnum):
    """What a job does."""

    DIAGNOSIS = "diagnosis"  # one dive, or several as one log
    HISTORY = "history"  # dives over time
    CALIBRATION = "calibration"  # a vehicle file from healthy dives


@dataclass(frozen=True)
class LogEntry:
    """One dive."""

    id: str
    name: str  # as it came, for people
    file: str  # its name on disk
    bytes: int
    digest: str  # SHA-256 of the content
    added: str
    state: LogState
    error: str  # why it is refused
    vehicle: str  # chosen, or proposed
    healthy: bool
    about: Mapping[str, Any] = field(default_factory=dict)  # what was read of it


@dataclass(frozen=True)
class Job:
    """One diagnosis, history or calibration."""

    id: str
    kind: JobKind
    vehicle: str
    logs: tuple[str, ...]
    healthy: tuple[str, ...]
    state: JobState
    share: float  # done, in [0, 1]
    stage: str
    error: str
    queued: str
    begun: str
    ended: str
    verdict: str
    summary: str


class Store:
    """The database and the folders beside it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for name in ("logs", "jobs", "incoming"):
            (folder / name).mkdir(parents=True, exist_ok=True, mode=0o700)
        self._database = sqlite3.connect(folder / "page.sqlite", check_same_thread=False, isolation_level=None)
        self._database.row_factory = sqlite3.Row
        self._database.execute("pragma journal_mode=wal")
        self._database.execute("pragma synchronous=normal")  # a loss of power may cost the last second
        self._database.executescript(_SCHEMA)

    def close(self) -> None:
        """Close the database."""
        self._database.close()

    def fact(self, name: str, first: str) -> str:
        """A value that stays from start to start; ``first`` where there is none yet."""
        self._database.execute("insert or ignore into facts values (?, ?)", (name, first))
        return self._database.execute("select value from facts where name = ?", (name,)).fetchone()[0]

    def folder_of(self, entry: LogEntry | Job) -> Path:
        """Where the files of a log or of a job are."""
        return self.folder / ("logs" if isinstance(entry, LogEntry) else "jobs") / entry.id

    def log(self, id: str) -> LogEntry:
        """One log.

        Raises:
            NoEntry: if there is none.
        """
        row = self._database.execute("select * from logs where id = ?", (id,)).fetchone()
        if row is None:
            raise NoEntry(f"there is no log {id!r}")
        return _log_of(row)

    def logs(self, state: LogState | None = None, most: int = -1) -> list[LogEntry]:
        """Logs, those that came first first: those in a state, or all; no more than ``most`` unless it is negative."""
        query = "select * from logs where ?1 is null or state = ?1 order by added, rowid limit ?2"
        return [_log_of(row) for row in self._database.execute(query, (state, most))]

    def last_vehicle(self, frame: str, thrusters: int | None) -> str:
        """That of the last dive with this frame; empty where there is none, or the frame is not known."""
        query = """select vehicle from logs where state = ? and vehicle != '' and json_extract(about, '$.frame') = ?
            and json_extract(about, '$.thrusters') is ? order by added desc, rowid desc limit 1"""
        row = self._database.execute(query, (LogState.READY, frame, thrusters)).fetchone()
        return row[0] if row is not None and (frame or thrusters) else ""

    def add_log(self, path: Path, name: str, file: str, size: int, digest: str) -> tuple[LogEntry, bool]:
        """Take over an uploaded file; the entry, and whether it is new: the same content is kept once."""
        row = self._database.execute("select * from logs where digest = ?", (digest,)).fetchone()
        if row is not None and row["state"] != LogState.REFUSED:
            path.unlink()
            return _log_of(row), False
        if row is not None:
            self.delete_log(row["id"])
        id = secrets.token_hex(_ID_BYTES)
        place = self.folder / "logs" / id / "upload"
        place.mkdir(parents=True, mode=0o700)
        path.replace(place / file)
        self._database.execute(
            "insert into logs values (?, ?, ?, ?, ?, ?, ?, '', '', 0, '{}')",
            (id, name, file, size, digest, now(), LogState.WAITING),
        )
        return self.log(id), True

    def change_log(self, id: str, **values: Any) -> LogEntry:
        """Set columns of a log."""
        _change(self._database, "logs", self.log(id).id, values)
        return self.log(id)

    def delete_log(self, id: str) -> None:
        """Forget a log and its files."""
        folder = self.folder_of(self.log(id))
        self._database.execute("delete from logs where id = ?", (id,))
        shutil.rmtree(folder, ignore_errors=True)  # what cannot be deleted is no longer reached by anybody

    def job(self, id: str) -> Job:
        """One job.

        Raises:
            NoEntry: if there is none.
        """
        row = self._database.execute("select * from jobs where id = ?", (id,)).fetchone()
        if row is None:
            raise NoEntry(f"there is no diagnosis {id!r}")
        return _job_of(row)

    def jobs(self) -> list[Job]:
        """All jobs, in the order in which they were asked for."""
        return [_job_of(row) for row in self._database.execute("select * from jobs order by queued, rowid")]

    def add_job(self, kind: JobKind, vehicle: str, logs: Iterable[str], healthy: Iterable[str]) -> Job:
        """Put a job into the queue."""
        id = secrets.token_hex(_ID_BYTES)
        values = (id, kind, vehicle, json.dumps(list(logs)), json.dumps(list(healthy)), JobState.WAITING, now())
        self._database.execute("insert into jobs values (?, ?, ?, ?, ?, ?, 0, '', '', ?, '', '', '', '')", values)
        return self.job(id)

    def change_job(self, id: str, **values: Any) -> Job:
        """Set columns of a job."""
        _change(self._database, "jobs", self.job(id).id, values)
        return self.job(id)

    def delete_job(self, id: str) -> None:
        """Forget a job and its files."""
        folder = self.folder_of(self.job(id))
        self._database.execute("delete from jobs where id = ?", (id,))
        shutil.rmtree(folder, ignore_errors=True)  # what cannot be deleted is no longer reached by anybody


def _change(database: sqlite3.Connection, table: str, id: str, values: Mapping[str, Any]) -> None:
    columns = ", ".join(f"{name} = ?" for name in values)  # names are those of our own code
    database.execute(f"update {table} set {columns} where id = ?", (*values.values(), id))


def _log_of(row: sqlite3.Row) -> LogEntry:
    values = {
        **row,
        "state": LogState(row["state"]),
        "healthy": bool(row["healthy"]),
        "about": json.loads(row["about"]),
    }
    return LogEntry(**values)


def _job_of(row: sqlite3.Row) -> Job:
    lists = {name: tuple(json.loads(row[name])) for name in ("logs", "healthy")}
    return Job(**{**row, **lists, "kind": JobKind(row["kind"]), "state": JobState(row["state"])})


def now() -> str:
    """The time as the page writes it down."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")
