"""What the extension serves: the light, the dives, the odometer, and who it is.

All paths are relative, for BlueOS serves extensions below a path of its own. A request that changes anything bears a
header that no form of another site can send.
"""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import reduce
from pathlib import Path
from typing import Any

from fastapi import FastAPI, HTTPException, Request
from fastapi.responses import FileResponse, JSONResponse
from fastapi.staticfiles import StaticFiles

from auv_light.odometer import add
from auv_light.watch import Watch
from auv_torchrl import __version__

STATIC = Path(__file__).parent / "static"
EVERY_S = 5.0  # between two looks at the log folder
OURS = "x-auv-light"  # the header of requests that change something
_NONE = "default-src 'none'; base-uri 'none'; form-action 'none'; "
POLICY = _NONE + "script-src 'self'; style-src 'self'; connect-src 'self'"
REPORT_POLICY = _NONE + "sandbox allow-scripts; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:"
SERVICE = {
    "name": "AUV light",
    "description": "After each dive: sound, look or stop, and why; an odometer of each thruster.",
    "icon": "mdi-traffic-light",
    "company": "auv_torchrl",
    "version": __version__,
    "webpage": "",
    "api": "docs",
    "new_page": False,
    "works_in_relative_paths": True,
    "extras": {"cockpit": "/cockpit_extras.json"},
}


def make_app(watch: Watch, every_s: float = EVERY_S) -> FastAPI:
    """The server over a watch, which works while the server does.

    Args:
        watch: over the dives.
        every_s: between two looks for work; 0 never looks, for tests that step themselves.
    """

    async def work() -> None:
        while True:
            if not await asyncio.to_thread(watch.step):
                await asyncio.sleep(every_s)

    @asynccontextmanager
    async def working(app: FastAPI) -> AsyncIterator[None]:
        task = asyncio.create_task(work()) if every_s else None
        yield
        if task is not None:
            task.cancel()

    app = FastAPI(title="AUV light", version=__version__, lifespan=working)
    _add_routes(app, watch)
    app.mount("/", StaticFiles(directory=STATIC, html=True))
    return app


def _add_routes(app: FastAPI, watch: Watch) -> None:
    @app.middleware("http")
    async def guard(request: Request, answer: Any) -> Any:
        if request.method not in ("GET", "HEAD") and OURS not in request.headers:
            return JSONResponse({"detail": f"a request that changes something needs the header {OURS}"}, 403)
        given = await answer(request)
        given.headers.setdefault("content-security-policy", POLICY)
        given.headers["x-content-type-options"] = "nosniff"
        return given

    @app.get("/register_service", include_in_schema=False)
    def register_service() -> dict[str, Any]:
        return SERVICE

    @app.get("/cockpit_extras.json", include_in_schema=False)
    def cockpit() -> dict[str, Any]:
        widget = {"name": "AUV light", "iframe_url": "/widget.html", "config_iframe_url": None, "version": __version__}
        return {"target_system": "Cockpit", "target_cockpit_api_version": "1.0.0", "widgets": [widget]}

    @app.get("/status")
    def status() -> dict[str, Any]:
        """The light of the newest dive, what is being done, and the work of each thruster."""
        dives = list(watch.dives)
        newest = next((dive for dive in dives if not dive.sound), None)
        shown = {"light": newest.light, "summary": newest.summary, "name": newest.name} if newest else {}
        total: list[dict[str, float]] = reduce(add, (dive.thrusters for dive in dives), [])
        return {"doing": watch.doing, "newest": shown, "thrusters": total, "dives": [vars(dive) for dive in dives]}

    @app.post("/dives/{id}/sound")
    def mark(id: str, sound: bool) -> dict[str, bool]:
        """Mark a dive as sound, or take the mark away; the newest dive is then held against those marked."""
        try:
            watch.dives[id].sound = sound
        except KeyError:
            raise HTTPException(404, "there is no such dive: GET /status lists them") from None
        watch.again()
        return {"sound": sound}

    @app.get("/dives/{id}/report")
    def report(id: str) -> FileResponse:
        """The report of a dive."""
        try:
            path = watch.dives.results(watch.dives[id]) / "report.html"
        except KeyError:
            raise HTTPException(404, "there is no such dive: GET /status lists them") from None
        if not path.is_file():
            raise HTTPException(404, "this dive has no report yet")
        return FileResponse(path, media_type="text/html", headers={"content-security-policy": REPORT_POLICY})
