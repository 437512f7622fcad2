"""The command ``auv-page``: a page on this machine to drop dives on."""

import argparse
import ipaddress
import socket
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from auv_torchrl import __version__
from auv_torchrl.extras import MissingLibrary, library

_BAD_INPUT = 2  # exit code, as for a wrong command line
_LAST_S = 2  # for answers that go on when the server is to end
PORT = 8766


def parser() -> argparse.ArgumentParser:
    """The command line."""
    made = argparse.ArgumentParser(
        prog="auv-page", description="A page to drop dives on: what is in them, and what is wrong with the vehicle."
    )
    made.add_argument(
        "--folder", type=Path, default=Path("outputs/page"), help="where dives and results are kept (%(default)s)"
    )
    made.add_argument(
        "--host", default="127.0.0.1", help="address to listen on; another than of this machine needs --elsewhere"
    )
    made.add_argument("--port", type=int, default=PORT, help="0 takes a free one (%(default)s)")
    made.add_argument(
        "--elsewhere", action="store_true",
        help="let other machines come: whoever reaches this one may see, diagnose and delete all dives; no password",
    )  # fmt: skip
    made.add_argument(
        "--name", action="append", default=[], help="by which browsers may also ask for it, such as boat.local"
    )
    made.add_argument("--version", action="version", version=f"auv_torchrl {__version__}")
    return made


def main(arguments: Sequence[str] | None = None) -> None:
    """Serve the page until Ctrl-C; ends with one line and exit code 2 on bad input."""
    given = parser().parse_args(arguments)
    try:
        address = _address(given.host, given.elsewhere)
        if not 0 <= given.port <= 65535:
            raise ValueError(f"--port {given.port} is no port: give one from 0 to 65535")
        for module in ("fastapi", "uvicorn", "python_multipart"):
            library(module, "auv-page needs", "page")
        _serve(given.folder, address, given.port, given.name, given.elsewhere)
    except (MissingLibrary, ValueError) as error:
        _fail(str(error))
    except OSError as error:
        _fail(f"{error.filename or f'{given.host}:{given.port}'}: {error.strerror or error}")


def _address(host: str, elsewhere: bool) -> str:
    """The address to listen on.

    Raises:
        ValueError: for one that is none, or that other machines reach although nobody said so.
    """
    host = "127.0.0.1" if host == "localhost" else host
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        raise ValueError(f"--host {host} is no address: give one like 127.0.0.1 or 0.0.0.0") from None
    if not address.is_loopback and not elsewhere:
        raise ValueError(
            f"--host {host} is reached by other machines, and whoever reaches it may see, diagnose and delete all "
            "dives, without a password: leave it out, or give --elsewhere as well"
        )
    return host


def _serve(folder: Path, host: str, port: int, names: Sequence[str], elsewhere: bool) -> None:
    from auv_torchrl.page.app import make_app  # here, not above: --help needs none of it
    from auv_torchrl.page.guard import LOOPBACK

    uvicorn = library("uvicorn", "auv-page needs", "page")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family) as listening:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((host, port))
        own = {socket.gethostname(), f"{socket.gethostname()}.local"} if elsewhere else set()
        app = make_app(folder, {*LOOPBACK, *own, *names}, any_address=elsewhere)
        shown = f"[{host}]" if ":" in host else host
        print(f"auv-page: open http://{shown}:{listening.getsockname()[1]}/ (Ctrl-C ends it)", flush=True)
        config = uvicorn.Config(
            app, log_level="warning", access_log=False, server_header=False, proxy_headers=False, ws="none",
            timeout_graceful_shutdown=_LAST_S,
        )  # fmt: skip
        uvicorn.Server(config).run(sockets=[listening])


def _fail(message: str) -> NoReturn:
    sys.stderr.write(f"auv-page: {message}\n")
    sys.exit(_BAD_INPUT)


if __name__ == "__main__":
    main()
