"""The process that runs a command for the page: the last to get the processor, the first to be ended for memory.

Its input is a pipe that the server holds. Where the server is gone, however it went, the pipe ends and so does
the process, so that the next server can run the job again.
"""

import os
import signal
import sys
import threading
from contextlib import suppress
from importlib import import_module
from pathlib import Path

_OOM = Path("/proc/self/oom_score_adj")  # of Linux: 1000 is ended first


def _end_with_server() -> None:
    while os.read(0, 1):  # past Python's buffer, whose lock would keep the process from ending by itself
        continue
    if hasattr(os, "killpg"):
        os.killpg(os.getpgid(0), signal.SIGKILL)  # with the processes that it started
    os._exit(1)


def stand_back(nice: int) -> None:
    """Leave processor and memory to others."""
    if hasattr(os, "nice"):
        os.nice(nice)
    with suppress(OSError):  # of a system without it
        _OOM.write_text("1000")


def main() -> None:
    """Run a command: how far it stands back, its module and its arguments are given."""
    nice, module, *arguments = sys.argv[1:]
    stand_back(int(nice))
    threading.Thread(target=_end_with_server, daemon=True).start()
    sys.argv = [module, *arguments]
    import_module(module).main()


if __name__ == "__main__":
    main()
