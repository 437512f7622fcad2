"""Errors that end a command with one line: what the user gave is wrong, or the machine cannot do it."""

import errno
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn

from auv_torchrl.text import printable

BAD_INPUT = 2  # exit code, as for a wrong command line
CANNOT_WRITE = 74  # exit code, EX_IOERR of sysexits.h

CHECKS: tuple[type[Exception], ...] = (ValueError, KeyError, FileNotFoundError, FileExistsError)
_FULL = {errno.ENOSPC, errno.EDQUOT}
_FORBIDDEN = {errno.EACCES, errno.EPERM, errno.EROFS}
_FULL_IN_WORDS = "No space left on device"  # all that rust's writers (safetensors, rerun) hand on


class BadInput(Exception):
    """Something that the user gave is wrong; the message is one line that says what to do."""

    code = BAD_INPUT


class CannotWrite(BadInput):
    """The disk is full or a folder may not be written; the message is one line that says what to do."""

    code = CANNOT_WRITE


@contextmanager
def checking_input(errors: tuple[type[Exception], ...] = CHECKS) -> Iterator[None]:
    """Turn ``errors`` of functions that check what the user gave into :class:`BadInput`.

    Those that come from a full disk become :class:`CannotWrite`: what the user gave is right.
    Only for such calls: elsewhere a ``ValueError`` is a defect of the program and keeps its traceback.
    """
    try:
        yield
    except errors as error:
        message = error.args[0] if isinstance(error, KeyError) else error
        full = any(isinstance(cause, OSError) and cause.errno in _FULL for cause in _chain(error))
        raise (CannotWrite if full else BadInput)(one_line(str(message))) from error


@contextmanager
def writing() -> Iterator[None]:
    """Turn a full disk and a folder that may not be written into :class:`CannotWrite`; other errors pass."""
    try:
        yield
    except BadInput:
        raise
    except Exception as error:
        for cause in _chain(error):
            number = cause.errno if isinstance(cause, OSError) else None
            where = f" ({cause.filename})" if isinstance(cause, OSError) and cause.filename else ""
            if number in _FULL or _FULL_IN_WORDS in str(cause):
                raise CannotWrite(
                    f"no space left on the disk{where}: make room and run the same command to go on, or give a folder "
                    "on another disk with output=DIR; what was written before is complete"
                ) from error
            if number in _FORBIDDEN:
                assert isinstance(cause, OSError)
                raise CannotWrite(
                    f"cannot read or write ({cause.strerror}){where}: give a file or folder for which you may"
                ) from error
        raise


def fail(command: str, error: BadInput) -> NoReturn:
    """End the command with its one line, in which names of files are made printable."""
    sys.stderr.write(f"{command}: {printable(str(error), None)}\n")
    sys.exit(error.code)


def one_line(message: str) -> str:
    """A message without its line breaks."""
    return " ".join(message.split())


def _chain(error: BaseException | None) -> Iterator[BaseException]:
    """An error and what it came from: torch raises a RuntimeError while it handles the OSError of its file."""
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__
