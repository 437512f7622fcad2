"""What a terminal shows: our own messages beside the progress, signs that it has; and logs on a full disk."""

import codecs
import io
import logging
import sys
from typing import TextIO

from auv_torchrl.command.ending import nobody_reads
from auv_torchrl.progress import beside_progress

_SIGNS = {
    "─": "-", "±": "+-", "≥": ">=", "≤": "<=", "–": "-", "—": "-", "→": "->", "·": "*", "×": "x", "°": "deg", "²": "^2",
    "³": "^3", "…": "...", "µ": "u", "μ": "u", "✓": "+", "●": "*", "◐": "*", "○": "o", "█": "#", "−": "-",
    "“": '"', "”": '"',
    "\u202f": " ", "\u00a0": " ",
}  # fmt: skip
_HANDLER = "auv_torchrl.signs"
_OURS = (
    "auv_torchrl",
    "benchmarks",
    "train",
    "diagnose",
    "calibrate",
    "sim",
    "export",
    "fly",
    "blind",
)  # names of loggers


def _spelt(error: UnicodeError) -> tuple[str | bytes, int]:
    r"""The signs that an encoding lacks in signs that every encoding has; others as ``\xfc``."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    lacking = error.object[error.start : error.end]
    return "".join(_SIGNS.get(c) or c.encode("ascii", "backslashreplace").decode() for c in lacking), error.end


def prepare_terminal() -> None:
    """Let signs be spelt that it lacks, and warnings of libraries go to the log of the run, where there is one."""
    spell_signs()
    logging.captureWarnings(True)


def spell_signs() -> None:
    """Let standard output and standard error spell what their encoding lacks instead of failing."""
    codecs.register_error(_HANDLER, _spelt)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_HANDLER)


class Console(logging.StreamHandler[TextIO]):
    """Shows what the program says, not what its libraries say of themselves: that goes to the log of the run alone.

    Hydra's warnings are shown, for they tell of what went wrong between the program and its settings.
    """

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether a record is for people."""
        origin = record.name.split(".")[0]
        shown = origin in _OURS or (origin == "hydra" and record.levelno >= logging.WARNING)
        return shown and bool(super().filter(record))

    def emit(self, record: logging.LogRecord) -> None:
        """Write it where the progress stands, which moves on."""
        with beside_progress():
            super().emit(record)

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802
        """Go on quietly where nobody reads on, as after ``auv-diagnose example | head``; defects are reported."""
        if not isinstance(sys.exc_info()[1], BrokenPipeError):
            return super().handleError(record)
        self.setLevel(logging.CRITICAL + 1)
        nobody_reads()


class LogFile(logging.FileHandler):
    """A log that ends with one line on the console when it can no longer be written, as on a full disk."""

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802
        """Say so once; defects of the program keep logging's own report."""
        error = sys.exc_info()[1]
        if not isinstance(error, OSError):
            return super().handleError(record)
        self.setLevel(logging.CRITICAL + 1)
        sys.stderr.write(f"{self.baseFilename} ends here: {error.strerror or error}\n")

    def close(self) -> None:
        """Close the file; what could not be written was reported before."""
        try:
            super().close()
        except OSError:
            if self.level <= logging.CRITICAL:  # not reported yet
                raise
