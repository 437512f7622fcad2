"""How far a command is: one line that is redrawn on a terminal, plain lines elsewhere."""

import io
import logging
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Self, TextIO

from auv_torchrl.quantities import duration

log = logging.getLogger(__name__)

EVERY_S = 1.0  # a terminal's line is redrawn so often, so that its time goes on while a long stage works
LINE_EVERY_S = 15.0  # elsewhere a stage that goes on says so again after so long
_KNOWN_SHARE, _KNOWN_S = 0.05, 2.0  # of the work and of time, before which nobody can tell how long the rest takes

_lock = threading.RLock()  # of the line on the terminal, which logging shares
_shown: list["Progress"] = []  # the one that is shown; those that begin inside it are not


class Progress:
    """Shows stage, share, time so far and, once it is known, time left; call it with the stage and the share done.

    The share never falls. One that begins while another is shown, as that of a training within a sweep, stays silent.

    Args:
        stream: of the terminal; standard error if not given.
        say: takes a plain line where the stream is no terminal; the log if not given.
        clock: in s.
    """

    def __init__(
        self,
        stream: TextIO | None = None,
        say: Callable[[str], None] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ):
        self.stream = sys.stderr if stream is None else stream
        self.say, self.clock = say or (lambda line: log.info("%s", line)), clock
        self.share, self.stage, self.note = 0.0, "", ""
        self._begun = self._moved = self._reported = clock()
        self._ended = threading.Event()
        self._silent = True

    def __enter__(self) -> Self:
        """Begin at nothing done."""
        self._begun = self._moved = self._reported = self.clock()
        with _lock:
            self._silent = bool(_shown)
            if not self._silent:
                _shown.append(self)
        if not self._silent and self.stream.isatty():
            threading.Thread(target=self._redraw, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        """Remove the line."""
        self._ended.set()
        if not self._silent:
            with _lock:
                self.clear()
                _shown.remove(self)

    def __call__(self, stage: str, share: float, note: str = "") -> None:
        """Show that ``share`` of the work, in [0, 1], is done and ``stage`` is going on; ``note`` says more of it."""
        with _lock:
            now, begins = self.clock(), stage != self.stage
            if share > self.share:  # a second look begins again, but nothing is undone
                self.share, self._moved = min(share, 1.0), now
            self.stage, self.note = stage, note
            if self._silent:
                return
            if self.stream.isatty():
                self.draw()
            elif begins or now - self._reported >= LINE_EVERY_S:
                self._reported = now
                self.say(self.line())

    def line(self) -> str:
        """What is shown: `` 42 % fitting candidates, 12 s so far, about 17 s left``."""
        now = self.clock()
        parts = [f"{100 * self.share:3.0f} % {self.stage}", f"{_seconds(now - self._begun)} so far"]
        if (left := self.left_s(now)) is not None:
            parts.append(f"about {_seconds(left)} left")
        return ", ".join([*parts, *([self.note] if self.note else [])])

    def left_s(self, now: float) -> float | None:
        """Seconds until all is done, if the rest goes as what is done went; None where that is not known."""
        took = self._moved - self._begun
        if not _KNOWN_SHARE <= self.share < 1 or took < _KNOWN_S:
            return None
        left = took * (1 - self.share) / self.share - (now - self._moved)
        return left if left >= 1 else None

    def draw(self) -> None:
        """Write the line over itself, cut to the width of the terminal."""
        width = shutil.get_terminal_size().columns - 1
        line = self.line()
        self._write(f"\r{line if len(line) <= width else line[: width - 1] + '…'}\x1b[K")

    def clear(self) -> None:
        """Remove the line from a terminal."""
        if self.stream.isatty():
            self._write("\r\x1b[K")

    def _write(self, text: str) -> None:
        with suppress(OSError, ValueError):  # a terminal that is gone ends no work
            self.stream.write(text)
            self.stream.flush()

    def _redraw(self) -> None:
        while not self._ended.wait(EVERY_S):
            with _lock:
                if not self._ended.is_set() and self.stage:
                    self.draw()


def _seconds(time_s: float) -> str:
    return f"{time_s:.0f} s" if time_s < 59.5 else duration(time_s)


@contextmanager
def beside_progress() -> Iterator[None]:
    """Write to the terminal inside: the line gives way and comes back."""
    with _lock:
        for progress in _shown:
            progress.clear()
        yield
        for progress in _shown:
            if progress.stage and progress.stream.isatty():
                progress.draw()


def show_no_progress() -> None:
    """Keep every progress of this process silent, as in the processes of a sweep, whose own one is shown."""
    with _lock:
        if not _shown:
            _shown.append(Progress(stream=io.StringIO()))
