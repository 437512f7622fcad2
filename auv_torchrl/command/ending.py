"""How every command begins and ends: signals, the cluster, and an end of one line whatever happens."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from auv_torchrl import __version__
from auv_torchrl.command.errors import BadInput, checking_input, fail

VERSION = f"auv_torchrl {__version__}"


@contextmanager
def ending(name: str) -> Iterator[None]:
    """End the command with one line and its exit code: on bad input, and when it is stopped."""
    try:
        yield
    except BadInput as error:
        fail(name, error)
    except KeyboardInterrupt as stopped:
        why = str(stopped) or "run the same command to go on"
        sys.stderr.write(f"{name}: interrupted: {why}\n")
        sys.exit(128 + getattr(stopped, "signum", signal.SIGINT))  # as shells have it


def say(text: str) -> None:
    """Print, and go on quietly where nobody reads on, as after ``auv-diagnose --help | head``."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        nobody_reads()


def nobody_reads() -> None:
    """Let what is still printed go nowhere, or Python fails once more at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextmanager
def on_cluster() -> Iterator[None]:
    """Let the cluster that is named, if any, do what is done side by side."""
    from auv_torchrl.parallel import use_cluster

    with checking_input():
        use_cluster()
    yield


@contextmanager
def terminable() -> Iterator[None]:
    """Let SIGTERM end what is inside as Ctrl-C does, unless somebody else handles it."""
    if threading.current_thread() is not threading.main_thread() or signal.getsignal(signal.SIGTERM) != signal.SIG_DFL:
        yield
        return
    from auv_torchrl.agents.interrupt import interrupt

    signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
