"""How far a command is, on a terminal and elsewhere."""

import io
import logging

from auv_torchrl.command import Console
from auv_torchrl.progress import Progress


class Terminal(io.StringIO):
    """A stream that says that it is a terminal."""

    def isatty(self):
        return True


class Clock:
    """A clock that is set by hand."""

    now = 0.0

    def __call__(self):
        return self.now


def screen(text):
    """The line that a terminal shows after ``text``."""
    shown = ""
    for part in text.replace("\x1b[K", "\x00").split("\r"):
        shown = part.replace("\x00", "") + (shown[len(part) :] if "\x00" not in part else "")
    return shown


def test_a_terminal_has_one_line_that_is_redrawn_and_in_the_end_removed():
    """Whatever was shown before, nothing of it is left over, and no line is wider than the terminal."""
    terminal, clock = Terminal(), Clock()
    with Progress(terminal, clock=clock) as progress:
        progress("a stage with a name that is longer than any terminal is wide " * 3, 0.2)
        clock.now = 12.0
        progress("short", 0.4)
        assert "\n" not in terminal.getvalue()
        assert screen(terminal.getvalue()) == " 40 % short, 12 s so far, about 18 s left"
        assert max(map(len, terminal.getvalue().split("\r"))) <= 83  # 79, and what erases the rest
    assert screen(terminal.getvalue()) == ""


def test_elsewhere_there_is_a_line_per_stage_and_one_where_a_stage_takes_long():
    """In plain text."""
    lines, clock = [], Clock()
    with Progress(io.StringIO(), lines.append, clock) as progress:
        for at, stage, share in ((0, "a", 0.0), (1, "a", 0.1), (2, "b", 0.5), (9, "b", 0.6), (30, "b", 0.75)):
            clock.now = at
            progress(stage, share)
    assert lines == [
        "  0 % a, 0 s so far",
        " 50 % b, 2 s so far, about 2 s left",
        " 75 % b, 30 s so far, about 10 s left",
    ]


def test_the_share_never_falls_and_the_time_left_counts_down():
    """A search that begins again undoes nothing; a time left that has passed is not told."""
    clock = Clock()
    with Progress(io.StringIO(), lambda _: None, clock) as progress:
        clock.now = 10.0
        progress("a", 0.5)
        progress("again", 0.2)
        assert progress.share == 0.5
        clock.now = 16.0
        assert progress.line() == " 50 % again, 16 s so far, about 4 s left"
        clock.now = 30.0
        assert progress.line() == " 50 % again, 30 s so far"
        progress("over", 1.5)
        assert progress.line() == "100 % over, 30 s so far"


def test_one_that_begins_within_another_is_silent():
    """A training within a sweep."""
    lines = []
    with Progress(io.StringIO(), lines.append) as outer, Progress(io.StringIO(), lines.append) as inner:
        outer("sweep", 0.1)
        inner("training", 0.1)
    assert len(lines) == 1 and "sweep" in lines[0]


def test_a_message_stands_above_the_line():
    """The line gives way to it and comes back."""
    terminal = Terminal()
    console = Console(terminal)
    with Progress(terminal) as progress:
        progress("searching", 0.1)
        console.handle(logging.LogRecord("auv_torchrl.x", logging.INFO, "", 0, "found", (), None))
        above, line = terminal.getvalue().rsplit("\n", 1)
        assert screen(above) == "found" and screen(line).startswith(" 10 % searching")


def test_the_console_shows_our_messages_and_none_of_libraries():
    """Warnings of libraries go to the log of the run; Hydra's, which tell of a callback that failed, are shown."""
    console, said = Console(stream := io.StringIO()), logging.LogRecord
    for name, level in (
        ("auv_torchrl.physics.kernel.native", logging.WARNING), ("train", logging.INFO),
        ("matplotlib.font_manager", logging.WARNING), ("absl", logging.ERROR), ("py.warnings", logging.WARNING),
        ("hydra.core.utils", logging.INFO), ("hydra._internal.callbacks", logging.WARNING),
    ):  # fmt: skip
        console.handle(said(name, level, "", 0, name, (), None))
    told = stream.getvalue().split()
    assert told == ["auv_torchrl.physics.kernel.native", "train", "hydra._internal.callbacks"]
