"""A page over a folder of its own, with a stand-in for the diagnosis, and a browser."""

import os
import shutil
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from auv_torchrl.page import jobs
from auv_torchrl.paths import EXAMPLE_LOG

EXTRA = [name for name in ("fastapi", "uvicorn", "python_multipart", "httpx") if find_spec(name) is None]
CHROMIUM = next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
)
PATIENCE_S = 90.0  # on a busy machine


def needs_extra() -> None:
    """Skip a test where the libraries of the page are not installed."""
    if EXTRA:
        pytest.skip(f"{', '.join(EXTRA)} not installed: pip install '.[dev,page]'")


@contextmanager
def serving(folder: Path, **settings: Any) -> Iterator[Any]:
    """A client of the page over a folder, as a program is."""
    needs_extra()
    testclient = pytest.importorskip("fastapi.testclient")
    from auv_torchrl.page.app import make_app

    app: Any = make_app(folder, nice=0, **settings)
    with testclient.TestClient(app, base_url="http://127.0.0.1:8766") as client:
        client.folder = folder
        yield client


@pytest.fixture(scope="module")
def standin() -> Iterator[None]:
    """Let jobs run the stand-in."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(jobs, "DIAGNOSE", "tests.page.standin")
        patch.setattr(jobs, "CALIBRATE", "tests.page.standin")
        yield


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory, standin: None) -> Iterator[Any]:
    """A client of a page with the stand-in; the process that reads logs takes seconds to begin, so tests share it."""
    with serving(tmp_path_factory.mktemp("shared") / "page") as made:
        yield made


def until(holds: Callable[[], Any], what: str) -> Any:
    """What ``holds`` returns once it is true."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        if found := holds():
            return found
        time.sleep(0.05)
    raise AssertionError(f"{what} did not come within {PATIENCE_S:g} s")


def dropped(client: Any, name: str = "flight.csv", content: bytes | None = None) -> dict[str, Any]:
    """A log that was sent and read; the example as a dive of its own where no content is given."""
    body = another() if content is None else content
    answer = client.post("/logs", params={"name": name}, content=body)
    assert answer.status_code == 201, answer.text
    (log,) = answer.json()["logs"]
    return until(lambda: (now := client.get(f"/logs/{log['id']}").json())["state"] != "waiting" and now, "the reading")


def over(client: Any, job: dict[str, Any]) -> dict[str, Any]:
    """A job once it is over."""
    return until(lambda: (now := client.get(f"/diagnoses/{job['id']}").json())["ended"] and now, "the end of a job")


_cut = count(1)


def another() -> bytes:
    """The example log less so many of its last rows that it is another dive than any before."""
    return b"".join(EXAMPLE_LOG.read_bytes().splitlines(keepends=True)[: -next(_cut)])


@contextmanager
def page_server(folder: Path) -> Iterator[str]:
    """The address of a page that a browser can open."""
    needs_extra()
    uvicorn = pytest.importorskip("uvicorn")
    from auv_torchrl.page.app import make_app

    app: Any = make_app(folder, nice=0)
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        server = uvicorn.Server(uvicorn.Config(app, log_level="warning", timeout_graceful_shutdown=1, ws="none"))
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]}, daemon=True)
        thread.start()
        until(lambda: server.started, "the server")
        yield f"http://127.0.0.1:{listening.getsockname()[1]}/"
        server.should_exit = True
        thread.join(PATIENCE_S)


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Chromium without a window."""
    if CHROMIUM is None or find_spec("playwright") is None:
        pytest.skip("no chromium, or playwright is not installed: pip install '.[dev]', apt-get install chromium")
    with pytest.importorskip("playwright.sync_api").sync_playwright() as driver:
        found = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"] if os.getuid() == 0 else [])
        yield found
        found.close()
