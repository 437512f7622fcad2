"""What a person sees while a command works: one banner per stage, with its time."""

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager

log = logging.getLogger(__name__)


class Stages:
    """Counts the stages of a command and reports when each begins and ends.

    Args:
        total: number of stages of this run.
    """

    def __init__(self, total: int):
        self.total = total
        self.number = 0

    @contextmanager
    def __call__(self, title: str) -> Iterator[None]:
        """Report a stage, and how long it took."""
        self.number += 1
        log.info("")
        log.info("── %d/%d %s", self.number, self.total, title)
        begun = time.perf_counter()
        yield
        log.info("   done in %s", readable(time.perf_counter() - begun))

    def skip(self, count: int, reason: str) -> None:
        """Say why the next stages are left out."""
        self.number += count
        log.info("")
        log.info("── %s", reason)


def readable(seconds: float) -> str:
    """``0.5 ms``, ``4.1 s`` or ``2 min 05 s``."""
    if seconds < 0.1:
        return f"{1e3 * seconds:.1f} ms"
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s"
