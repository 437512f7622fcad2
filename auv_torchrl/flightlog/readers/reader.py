"""Which reader takes a file: by what is in it, and by its suffix where that does not tell."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from auv_torchrl import extras
from auv_torchrl.flightlog.findings import FlightLogError
from auv_torchrl.flightlog.streams.stream import ReadOptions, Streams
from auv_torchrl.flightlog.tables.header import first_bytes

HEAD_BYTES = 4096  # that a reader is shown of a file
_POINTERS = {  # what stands in place of a file that was not fetched
    b"version https://git-lfs": "git-lfs and not the log itself: fetch it with git lfs pull",
    b"/annex/objects/": "git-annex and not the log itself: fetch it with git annex get",
}


class Reader(NamedTuple):
    """One format."""

    name: str  # for people
    suffixes: tuple[str, ...]  # in small letters
    recognizes: Callable[[bytes], bool]  # the first bytes of a file
    read: Callable[[Path, ReadOptions], Streams]
    folders: Callable[[Path], bool] = lambda path: False  # whether a folder is one log


def choose_reader(path: Path, readers: Mapping[str, Reader]) -> Reader | None:
    """The reader of a file; None for a table, which is what every other text and Parquet file is.

    Raises:
        FlightLogError: for a file that cannot be read, that stands for another one, or whose name promises a format
            that it does not have.
    """
    if path.is_dir():
        for reader in readers.values():
            if reader.folders(path):
                return reader
    head = first_bytes(path, HEAD_BYTES)
    refuse_pointer(path.name, head)
    fitting = [reader for reader in readers.values() if reader.recognizes(head)]
    suffix = path.suffix.lower()
    named = [reader for reader in readers.values() if suffix in reader.suffixes]
    if fitting:
        return next((reader for reader in fitting if reader in named), fitting[0])
    if named and head:
        raise FlightLogError(
            f"{path.name} is no {named[0].name} although it is named so (it begins with {head[:8]!r}): copy it from "
            "the vehicle again"
        )
    return None


def refuse_pointer(name: str, head: bytes) -> None:
    """Name a file that stands for another one, which was not fetched.

    Raises:
        FlightLogError: for such a file, saying how to fetch the other one.
    """
    for begin, remedy in _POINTERS.items():
        if head.startswith(begin):
            raise FlightLogError(f"{name} is a pointer of {remedy}, or download it")


def library(module: str, needed_for: str) -> Any:
    """A module of an optional library.

    Raises:
        FlightLogError: if it is not installed, saying how to.
    """
    return extras.library(module, f"{needed_for} is read by", "logs", FlightLogError)
