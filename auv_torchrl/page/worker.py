"""What the page does behind the requests: it reads logs as they come, and runs jobs one by one."""

import asyncio
import json
import logging
import os
import re
import shutil
import signal
import subprocess
import sys
from collections import deque
from collections.abc import AsyncIterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from auv_torchrl.page.jobs import command_of, files_of
from auv_torchrl.page.proposal import propose
from auv_torchrl.page.store import Job, JobKind, JobState, LogEntry, LogState, Store, now
from auv_torchrl.text import printable

log = logging.getLogger(__name__)

_PACKAGE = Path(__file__).resolve().parents[1]
NICE = 10  # how far jobs stand back behind other programs
PRINTED = "output.txt"  # what the command of a job printed
_PROGRESS = re.compile(r" *(\d{1,3}) % (.+?), \d")  # a line of auv_torchrl.progress
_ERROR = re.compile(r"(?:diagnose|calibrate): (.+)")  # how the commands end on bad input
_READING_S = 300.0  # after which a log that is still read is refused
_IDLE_S = 60.0  # after which the process that reads logs ends
_GRACE_S = 5.0  # between asking a job to end and ending it
_KEPT_LINES = 40  # of what a job printed, to look for its error
_MOST_PRINTED = 4 << 20  # bytes of it on disk
_LONGEST_LINE = 4000


class Board:
    """Says to everybody who watches that something has changed."""

    def __init__(self) -> None:
        self.version = 0  # of what is there and how far it is,
        self.shape = 0  # and of what is there alone
        self._changed = asyncio.Event()

    def tell(self, is_progress: bool = False) -> None:
        """Something has changed; ``is_progress`` where it is no more than how far a job is."""
        self.version += 1
        self.shape += not is_progress
        self._changed.set()
        self._changed = asyncio.Event()

    async def wait(self, seconds: float) -> None:
        """Until something changes, or for so long."""
        with suppress(TimeoutError):
            await asyncio.wait_for(self._changed.wait(), seconds)

    async def changes(self, beat_s: float) -> AsyncIterator[str]:
        """``hello``, then ``changed`` or ``progress`` whenever something has changed, and empty after so long without.

        What changes while an answer is on its way is told with the next one.
        """
        seen, shape = self.version, self.shape
        yield "hello"
        while True:
            if self.version == seen:
                await self.wait(beat_s)
            if self.version == seen:
                yield ""
                continue
            kind = "progress" if self.shape == shape else "changed"
            seen, shape = self.version, self.shape
            yield kind


class Worker:
    """Two lanes, one for logs and one for jobs; each does one thing at a time."""

    def __init__(self, store: Store, board: Board, nice: int = NICE) -> None:
        self.store, self.board, self.nice = store, board, nice
        self._reader: asyncio.subprocess.Process | None = None
        self._running: tuple[str, asyncio.subprocess.Process] | None = None
        self._tasks: list[asyncio.Task[None]] = []

    def start(self) -> None:
        """Go on where the server before this one ended."""
        for job in self.store.jobs():
            if job.state is JobState.RUNNING:
                self.store.change_job(job.id, state=JobState.WAITING, share=0.0, stage="")
        for name in ("incoming", "temporary"):  # what was broken off
            shutil.rmtree(self.store.folder / name, ignore_errors=True)
            (self.store.folder / name).mkdir(mode=0o700, exist_ok=True)
        self._tasks = [
            asyncio.create_task(self._lane(self._read_next)),
            asyncio.create_task(self._lane(self._run_next)),
        ]

    async def stop(self) -> None:
        """End what is running; it begins again with the next server."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        for process in (self._reader, self._running and self._running[1]):
            if process is not None:
                await _end(process)

    async def cancel(self, job: Job) -> Job:
        """End a job that waits or runs."""
        if self._running is not None and self._running[0] == job.id:
            self.store.change_job(job.id, state=JobState.CANCELLED, ended=now())
            await _end(self._running[1])
        elif not job.state.is_over:
            self.store.change_job(job.id, state=JobState.CANCELLED, ended=now())
        self.board.tell()
        return self.store.job(job.id)

    async def _lane(self, next_one: Any) -> None:
        while True:
            try:
                if not await next_one():
                    await self.board.wait(_IDLE_S)
            except (OSError, LookupError, ValueError):  # of a full disk, or of what was deleted meanwhile
                log.exception("the page goes on after this")
                await asyncio.sleep(1.0)

    async def _read_next(self) -> bool:
        waiting = next(iter(self.store.logs(LogState.WAITING, most=1)), None)
        if waiting is None:
            if self._reader is not None:
                before = self.board.version
                await self.board.wait(_IDLE_S)
                if self.board.version == before:
                    await _end(self._reader)
                    self._reader = None
                return True
            return False
        about = await self._read(waiting)
        with suppress(LookupError):  # it was deleted meanwhile
            self._keep(waiting, about)
        self.board.tell()
        return True

    def _keep(self, entry: LogEntry, about: dict[str, Any]) -> None:
        if "error" in about:
            self.store.change_log(entry.id, state=LogState.REFUSED, error=about["error"])
            shutil.rmtree(self.store.folder_of(entry) / "upload", ignore_errors=True)
            return
        earlier = self.store.last_vehicle(about.get("frame", ""), about.get("thrusters"))
        vehicle, why = propose(about, earlier)
        about["why"] = why
        self.store.change_log(entry.id, state=LogState.READY, vehicle=vehicle, about=json.dumps(about))

    async def _read(self, entry: LogEntry) -> dict[str, Any]:
        folder = self.store.folder_of(entry).absolute()
        if self._reader is None or self._reader.returncode is not None:
            self._reader = await self._start("auv_torchrl.page.recognise", "reader")
        reader = self._reader
        assert reader.stdin is not None and reader.stdout is not None  # they are pipes
        try:
            reader.stdin.write(f"{folder}\n".encode())
            await reader.stdin.drain()
            answer = await asyncio.wait_for(reader.stdout.readline(), _READING_S)
        except TimeoutError:
            await _end(reader)
            return {"error": f"reading it took longer than {_READING_S:g} s"}
        except ConnectionError:
            answer = b""
        if not answer:
            await _end(reader)
            return {"error": f"reading it ended the program that reads logs (code {reader.returncode})"}
        return json.loads((folder / "about.json").read_bytes())

    async def _run_next(self) -> bool:
        job = next((job for job in self.store.jobs() if job.state is JobState.WAITING), None)
        if job is None:
            return False
        folder = self.store.folder_of(job)
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        module, arguments = command_of(self.store, job)
        process = await self._start("auv_torchrl.page.child", job.id, str(self.nice), module, *arguments)
        self._running = job.id, process
        self.store.change_job(job.id, state=JobState.RUNNING, begun=now(), share=0.0, stage="starting", error="")
        self.board.tell()
        try:
            printed = await self._follow(job, process, folder / PRINTED)
            code = await process.wait()
        finally:
            if process.returncode is None:
                await _end(process)
            self._running = None
            shutil.rmtree(self._temporary(job.id), ignore_errors=True)
        with suppress(LookupError):
            self._finish(self.store.job(job.id), code, printed)
        self.board.tell()
        return True

    async def _follow(self, job: Job, process: asyncio.subprocess.Process, path: Path) -> list[str]:
        """Its last lines; tells how far it is as it says so."""
        assert process.stdout is not None  # it is a pipe
        lines: deque[str] = deque(maxlen=_KEPT_LINES)
        left, written = b"", 0
        with path.open("wb") as file:
            while piece := await process.stdout.read(1 << 16):
                if written < _MOST_PRINTED:
                    file.write(piece)
                    file.flush()
                    written += len(piece)
                *whole, left = (left + piece).split(b"\n")
                left = left[-_LONGEST_LINE:]
                for line in whole:
                    text = printable(line.decode("utf-8", "replace"), _LONGEST_LINE)
                    lines.append(text)
                    if matched := _PROGRESS.match(text):
                        self.store.change_job(job.id, share=min(int(matched[1]), 100) / 100, stage=matched[2])
                        self.board.tell(is_progress=True)
        return [*lines, left.decode("utf-8", "replace")]

    def _finish(self, job: Job, code: int, printed: list[str]) -> None:
        if job.state is not JobState.RUNNING:
            return  # cancelled
        files = files_of(self.store, job)
        if code == 0:
            answer = {}
            if (name := "dives.json" if job.kind is JobKind.HISTORY else "diagnosis.json") in files:
                answer = json.loads(files[name].read_bytes())
            summary = answer.get("headline") or answer.get("summary", "The vehicle file is written.")
            values = {"verdict": answer.get("verdict", ""), "summary": summary, "share": 1.0, "stage": "done"}
            self.store.change_job(job.id, state=JobState.DONE, ended=now(), **values)
            return
        errors = [found[1] for line in printed if (found := _ERROR.match(line))]
        last = next((line for line in reversed(printed) if line.strip()), "")
        killed = f"it was ended by signal {-code}, as by a system that has no memory left" if code < 0 else ""
        error = next(iter(errors[-1:]), "") or killed or last or f"it ended with code {code}"
        self.store.change_job(job.id, state=JobState.FAILED, ended=now(), error=error)

    async def _start(self, module: str, own: str, *arguments: str) -> asyncio.subprocess.Process:
        temporary = self._temporary(own)
        temporary.mkdir(parents=True, exist_ok=True, mode=0o700)
        environment = {**os.environ, "TMPDIR": str(temporary), "TEMP": str(temporary), "PYTHONUNBUFFERED": "1",
                       "OMP_NUM_THREADS": "1"}  # fmt: skip
        own_path = (str(_PACKAGE.parent), os.environ.get("PYTHONPATH", ""))
        environment["PYTHONPATH"] = os.pathsep.join(filter(None, own_path))
        # -P: the folder of the page, in which uploads lie, is no place to import from
        return await asyncio.create_subprocess_exec(
            sys.executable, "-P", "-m", module, *arguments, cwd=self.store.folder, env=environment,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=os.name == "posix",
            stderr=subprocess.DEVNULL if module.endswith("recognise") else subprocess.STDOUT,
        )  # fmt: skip

    def _temporary(self, own: str) -> Path:
        return self.store.folder.absolute() / "temporary" / own


async def _end(process: asyncio.subprocess.Process) -> None:
    """End a process and those that it started: first it is asked, so that it leaves its folder in order."""
    for seconds, number in ((_GRACE_S, signal.SIGTERM), (_GRACE_S, getattr(signal, "SIGKILL", signal.SIGTERM))):
        if process.returncode is not None:
            return
        with suppress(ProcessLookupError):
            if os.name == "posix":
                os.killpg(process.pid, number)
            else:
                process.terminate()
        with suppress(TimeoutError):
            await asyncio.wait_for(process.wait(), seconds)
