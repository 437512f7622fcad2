"""The pages for people, made on the server; what their buttons ask for is what the interface for programs does."""

from datetime import datetime
from pathlib import Path
from typing import Any
from urllib.parse import quote

import jinja2

from auv_torchrl import __version__
from auv_torchrl.extras import library
from auv_torchrl.page.jobs import ABOUT_FILES, JobError, files_of, request_job, vehicles
from auv_torchrl.page.refusal import Refusal
from auv_torchrl.page.rest import LogChange, about_file, change_log, history_of, remove_log, report_name
from auv_torchrl.page.store import JobKind, LogEntry, LogState, NoEntry, Store
from auv_torchrl.page.worker import Board, Worker
from auv_torchrl.quantities import counted, duration, words
from auv_torchrl.text import printable

fastapi = library("fastapi", "the page needs", "page")
responses = library("fastapi.responses", "the page needs", "page")
Request = fastapi.Request

_HERE = Path(__file__).parent
STATIC = _HERE / "static"
_UNITS = ("B", "kB", "MB", "GB")
_GLYPH = {"no_gap": "✓", "explained": "●", "partly_explained": "◐", "unexplained": "○"}
_SHOWN_JOBS = 30  # on the first page
_MOST_CHANGED = 200  # parameters that differ, on the page that compares


class Screens:
    """Turns templates into pages."""

    def __init__(self, store: Store) -> None:
        self.store = store
        self.environment = jinja2.Environment(
            loader=jinja2.FileSystemLoader(_HERE / "templates"), autoescape=True, undefined=jinja2.StrictUndefined,
            trim_blocks=True, lstrip_blocks=True,
        )  # fmt: skip
        self.environment.globals |= {"version": __version__, "glyph": _GLYPH}
        self.environment.filters |= {
            "counted": counted, "duration": duration, "size": size, "day": day, "printable": printable, "words": words,
            "address": lambda text: quote(str(text), safe=""),
        }  # fmt: skip

    def __call__(self, request: Any, template: str, status: int = 200, **values: Any) -> Any:
        """A page; its links are relative, so that it also works behind another server and below a path of it."""
        depth = request.url.path.removeprefix(request.scope.get("root_path", "")).count("/") - 1
        root = "../" * depth or "./"
        choices = vehicles(self.store)
        page = self.environment.get_template(template).render(root=root, vehicles=choices, **values)
        return responses.HTMLResponse(page, status)

    def name_of(self, id: str) -> str:
        """Of a dive, for people."""
        try:
            return printable(self.store.log(id).name)
        except NoEntry:
            return "a dive that was deleted"


def size(number: float) -> str:
    """Bytes for people."""
    for unit in _UNITS:
        if number < 1000 or unit == _UNITS[-1]:
            return f"{number:.3g} {unit}"
        number /= 1000
    raise AssertionError("the last unit takes all")


def day(text: str) -> str:
    """A time as the store has it, for people; what is none stays as it is."""
    try:
        return datetime.fromisoformat(text).strftime("%Y-%m-%d %H:%M")
    except ValueError:
        return text


# long: one page below the other
def routes(store: Store, worker: Worker, board: Board) -> Any:
    """The routes of the pages."""
    router, screens = fastapi.APIRouter(include_in_schema=False), Screens(store)

    @router.get("/")
    async def index(request: Request) -> Any:
        entries, jobs = store.logs(), store.jobs()
        last = {id: job for job in jobs if job.kind is JobKind.DIAGNOSIS and len(job.logs) == 1 for id in job.logs}
        return screens(
            request, "index.html.j2", logs=entries[::-1], jobs=jobs[::-1][:_SHOWN_JOBS], last=last,
            name_of=screens.name_of,
        )  # fmt: skip

    @router.get("/dive/{id}")
    async def dive(request: Request, id: str) -> Any:
        entry = store.log(id)
        others = [
            other for other in store.logs()
            if other.id != id and other.healthy and other.state is LogState.READY
        ]  # fmt: skip
        own = [job for job in store.jobs() if id in job.logs]
        return screens(request, "dive.html.j2", log=entry, healthy=others, jobs=own[::-1], name_of=screens.name_of)

    @router.get("/diagnosis/{id}")
    async def diagnosis(request: Request, id: str) -> Any:
        job = store.job(id)
        files = files_of(store, job) if job.state.is_over else {}
        order = list(ABOUT_FILES)
        named = sorted((name for name in files if about_file(name)), key=lambda n: order.index(n) if n in order else -1)
        shown = [(name, files[name].stat().st_size, about_file(name)) for name in named]
        return screens(
            request, "diagnosis.html.j2", job=job, report=report_name(job, files), files=shown, name_of=screens.name_of,
            is_one=job.kind is JobKind.DIAGNOSIS and len(job.logs) == 1,
        )  # fmt: skip

    @router.get("/vehicle/")
    async def all_vehicles(request: Request) -> Any:
        flown = [entry.vehicle for entry in store.logs()]
        return screens(request, "vehicles.html.j2", dives={name: flown.count(name) for name in vehicles(store)})

    @router.get("/vehicle/{name}")
    async def vehicle(request: Request, name: str) -> Any:
        if name not in vehicles(store):
            raise NoEntry(f"there is no vehicle {printable(name)!r}")
        dives, jobs = history_of(store, name)
        return screens(request, "vehicle.html.j2", name=name, dives=dives, jobs=jobs[::-1], name_of=screens.name_of)

    @router.get("/compare")
    async def compare(request: Request) -> Any:
        chosen = list(dict.fromkeys(request.query_params.getlist("dive")))
        if len(chosen) != 2:
            raise JobError("choose two dives to compare")
        pair = sorted(map(store.log, chosen), key=lambda entry: (entry.about.get("begun") or entry.added, entry.added))
        last = [
            next((job for job in reversed(store.jobs()) if job.logs == (entry.id,) and job.verdict), None)
            for entry in pair
        ]
        return screens(request, "compare.html.j2", pair=pair, last=last, changed=changed_parameters(*pair))

    @router.get("/api")
    async def api(request: Request) -> Any:
        found = [
            (method.upper(), path, about.get("summary", ""))
            for path, methods in request.app.openapi()["paths"].items()
            for method, about in methods.items()
        ]
        return screens(request, "api.html.j2", operations=found)

    @router.post("/ui/dive/{id}/{what}")
    async def change(request: Request, id: str, what: str) -> Any:
        form = await request.form()
        if what == "healthy":
            change_log(store, board, id, LogChange(healthy=form.get("value") == "1"))
        elif what == "vehicle":
            change_log(store, board, id, LogChange(vehicle=str(form.get("vehicle", ""))))
        elif what == "delete":
            remove_log(store, board, id)
            return responses.RedirectResponse("../../../", 303)
        else:
            raise NoEntry(f"there is nothing to do called {printable(what)!r}")
        return _back(form)

    @router.post("/ui/{kind}")
    async def ask(request: Request, kind: str) -> Any:
        form = await request.form()
        if kind not in set(JobKind):
            raise NoEntry(f"there is nothing to do called {printable(kind)!r}")
        given = [str(id) for id in form.getlist("healthy")] if "chosen" in form else None
        logs = [str(id) for id in form.getlist("log")]
        job = request_job(store, JobKind(kind), logs, given, str(form.get("vehicle", "")) or None)
        board.tell()
        return responses.RedirectResponse(f"../diagnosis/{job.id}", 303)

    @router.post("/ui/cancel/{id}")
    async def cancel(request: Request, id: str) -> Any:
        await worker.cancel(store.job(id))
        return responses.RedirectResponse(f"../../diagnosis/{id}", 303)

    return router


def _back(form: Any) -> Any:
    """To the page from which a form came: a dive's own, or the first one."""
    at = str(form.get("at", ""))
    return responses.RedirectResponse(f"../../../dive/{at}" if at.isalnum() else "../../../", 303)


def changed_parameters(a: LogEntry, b: LogEntry) -> list[tuple[str, float | None, float | None]]:
    """Parameters of the autopilot that differ between two dives."""
    left, right = a.about.get("parameters", {}), b.about.get("parameters", {})
    if not left or not right:
        return []
    names = sorted({*left, *right})
    return [(n, left.get(n), right.get(n)) for n in names if left.get(n) != right.get(n)][:_MOST_CHANGED]


def refusal(screens: Screens, request: Any, error: Refusal) -> Any:
    """What is said of a request that cannot be answered: a page to browsers, JSON to programs."""
    text, status = printable(str(error), None), error.status
    if "text/html" in request.headers.get("accept", ""):
        return screens(request, "refusal.html.j2", status, message=text)
    return responses.JSONResponse({"detail": text}, status)
