"""The application: store, worker, interface and pages behind the guard."""

import secrets
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from auv_torchrl import __version__
from auv_torchrl.extras import library
from auv_torchrl.page import rest, screens
from auv_torchrl.page.guard import LOOPBACK, Guard
from auv_torchrl.page.refusal import Refusal
from auv_torchrl.page.store import Store
from auv_torchrl.page.upload import MOST_BYTES
from auv_torchrl.page.worker import NICE, Board, Worker

fastapi = library("fastapi", "the page needs", "page")
staticfiles = library("fastapi.staticfiles", "the page needs", "page")
Request = fastapi.Request


class FolderInUse(ValueError):
    """Another server works in the folder."""


def make_app(
    folder: Path,
    names: Iterable[str] = LOOPBACK,
    any_address: bool = False,
    most_bytes: int = MOST_BYTES,
    nice: int = NICE,
) -> Guard:
    """The application over a folder; nothing of the folder is touched before it starts.

    Args:
        folder: of dives, jobs and the database.
        names: by which browsers may ask for it.
        any_address: whether they may use any address in numbers, as where other machines may come.
        most_bytes: of one log.
        nice: how far jobs stand back behind other programs.

    Raises:
        FolderInUse: if another server works in the folder.
    """
    folder = folder.absolute()
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    lock = FileLock(folder / ".lock", thread_local=False)
    try:
        lock.acquire(blocking=False)
    except Timeout as error:
        raise FolderInUse(f"{folder} is used by another auv-page: open that one, or give --folder OTHER") from error
    store, board = Store(folder), Board()
    worker = Worker(store, board, nice)

    @asynccontextmanager
    async def life(_: Any) -> AsyncIterator[None]:
        worker.start()
        try:
            yield
        finally:
            await worker.stop()
            store.close()
            lock.release()

    app = fastapi.FastAPI(
        title="auv_torchrl", version=__version__, lifespan=life, docs_url=None, redoc_url=None,
        description="What is in a dive of an underwater vehicle, and what is wrong with the vehicle.",
    )  # fmt: skip
    app.include_router(rest.routes(store, worker, board, most_bytes))
    app.include_router(screens.routes(store, worker, board))
    app.mount("/static", staticfiles.StaticFiles(directory=screens.STATIC))
    pages = screens.Screens(store)

    async def refuse(request: Request, error: Any) -> Any:
        return screens.refusal(pages, request, error)

    app.add_exception_handler(Refusal, refuse)
    return Guard(app, names, any_address, store.fact("token", secrets.token_urlsafe(32)))
