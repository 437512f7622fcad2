"""Terminals without Unicode and logs on a full disk: what a command says is still said."""

import codecs
import io
import logging
import sys

_SIGNS = {
    "─": "-", "±": "+-", "≥": ">=", "≤": "<=", "–": "-", "—": "-", "→": "->", "·": "*", "×": "x", "°": "deg", "²": "^2",
    "³": "^3", "…": "...", "µ": "u", "μ": "u", "✓": "+", "●": "*", "◐": "*", "○": "o", "█": "#", "−": "-",
    "“": '"', "”": '"',
    "\u202f": " ", "\u00a0": " ",
}  # fmt: skip
_HANDLER = "auv_torchrl.signs"


def _spelt(error: UnicodeError) -> tuple[str | bytes, int]:
    r"""The signs that an encoding lacks in signs that every encoding has; others as ``\xfc``."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    lacking = error.object[error.start : error.end]
    return "".join(_SIGNS.get(c) or c.encode("ascii", "backslashreplace").decode() for c in lacking), error.end


def spell_signs() -> None:
    """Let standard output and standard error spell what their encoding lacks instead of failing."""
    codecs.register_error(_HANDLER, _spelt)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_HANDLER)


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
