"""What a person sees while a command works: one banner per stage, with its time."""

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager

from auv_torchrl.quantities import duration

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
        log.info("   done in %s", duration(time.perf_counter() - begun))

    def skip(self, count: int, reason: str) -> None:
        """Say why the next stages are left out."""
        self.number += count
        log.info("")
        log.info("── %s", reason)
