"""Ctrl-C and SIGTERM as a wish to stop at the next good moment."""

import logging
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NoReturn

log = logging.getLogger(__name__)


class Interrupted(KeyboardInterrupt):
    """Ctrl-C or SIGTERM, after what there is was saved; the message says how to go on, ``signum`` which of them."""

    def __init__(self, message: str = "", signum: int = signal.SIGINT):
        super().__init__(message)
        self.signum = signum


def interrupt(signum: int, frame: object) -> NoReturn:
    """The handler by which SIGTERM ends a command as Ctrl-C does."""
    raise Interrupted(signum=signum)


AT_CHECKPOINT = "finishing the running stretch, then saving; Ctrl-C again stops at once, at the last checkpoint"


@contextmanager
def interruptible(say: str = AT_CHECKPOINT) -> Iterator[Callable[[], int | None]]:
    """Turn the first Ctrl-C or SIGTERM into a wish that the loop asks for; the second one interrupts at once.

    The loop asks for the number of the signal, None if there was none; ``say`` is what people read meanwhile. A handler
    of SIGTERM that is not ours stays, as that of a cluster's launcher.
    """
    asked: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield lambda: None  # only the main thread receives signals
        return

    def ask(signum: int, frame: object) -> None:
        if asked:
            raise Interrupted(signum=signum)
        asked.append(signum)
        log.warning("%s", say)

    ours = [signal.SIGINT]
    if signal.getsignal(signal.SIGTERM) in (signal.SIG_DFL, interrupt):
        ours.append(signal.SIGTERM)
    before = {number: signal.signal(number, ask) for number in ours}
    try:
        yield lambda: asked[0] if asked else None
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
