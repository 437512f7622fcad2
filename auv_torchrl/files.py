"""Files that are written whole or not at all, and locks that end with the process that holds them."""

import errno
import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

from filelock import FileLock, Timeout

log = logging.getLogger(__name__)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file so that it holds either what it held or all of ``content``, whenever the process dies.

    Raises:
        OSError: if it cannot be written; what it held is left.
    """
    with whole(path) as partial, partial.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Where to write what takes the place of ``path`` once all is written; nothing is left of it if that fails."""
    partial = path.with_name(f".{path.name}.partial")
    try:
        yield partial
        partial.replace(path)
    except BaseException:
        partial.unlink(missing_ok=True)  # it takes the room that is missing
        raise


def write_text(path: Path, text: str) -> None:
    """:func:`write_whole` for text, in UTF-8."""
    write_whole(path, encoded(text))


def encoded(text: str) -> bytes:
    """Text in UTF-8; names of files in it that are no UTF-8 keep their bytes."""
    return text.encode("utf-8", "surrogateescape")


@cache
def say_not_kept(reason: str) -> None:
    """Say once that caches of this process keep nothing: that costs time and nothing else."""
    log.warning("nothing can be kept for the next start (%s): what takes long is worked out again each time", reason)


@contextmanager
def locked(path: Path, what: str) -> Iterator[None]:
    """Hold an exclusive lock that the system releases when the process ends, however it ends.

    Where nobody may write, nothing has to be locked: who only reads goes on, who writes is told.

    Args:
        path: of the lock.
        what: the other process does, for the log where this one has to wait.
    """
    lock = FileLock(path)
    try:
        lock.acquire(blocking=False)
    except Timeout:
        log.info("another process %s: waiting for it", what)
        lock.acquire()
    except OSError as error:
        if error.errno not in (errno.EACCES, errno.EROFS):
            raise
    try:
        yield
    finally:
        lock.release()
