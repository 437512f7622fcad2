"""Which reader takes a file: by what is in it, and by its suffix where that does not tell."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, NamedTuple

from auv_torchrl.flightlog.findings import FlightLogError
from auv_torchrl.flightlog.header import first_bytes
from auv_torchrl.flightlog.streams.stream import ReadOptions, Streams

GROUP = "auv_torchrl.readers"  # of entry points; each names a Reader
HEAD_BYTES = 4096  # that a reader is shown of a file
_POINTER = b"version https://git-lfs"


class Reader(NamedTuple):
    """One format."""

    name: str  # for people
    suffixes: tuple[str, ...]  # in small letters
    recognizes: Callable[[bytes], bool]  # the first bytes of a file
    read: Callable[[Path, ReadOptions], Streams]
    folders: Callable[[Path], bool] = lambda path: False  # whether a folder is one log


class Registry(Mapping[str, Reader]):
    """Readers by name: those of the package, then those of other packages, read when first asked for."""

    def __init__(self, readers: Iterable[Reader]) -> None:
        self._built_in = tuple(readers)
        self._known: dict[str, Reader] = {}

    def __getitem__(self, name: str) -> Reader:
        return self._readers()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._readers())

    def __len__(self) -> int:
        return len(self._readers())

    def _readers(self) -> dict[str, Reader]:
        if not self._known:
            known: dict[str, Reader] = {}
            for reader in self._built_in:
                known = _with(known, reader, "this package")
            for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name):
                known = _with(known, _loaded(entry), f"the entry point {entry.value}")
            self._known = known
        return self._known


def choose_reader(path: Path, readers: Mapping[str, Reader]) -> Reader | None:
    """The reader of a file; None for a table, which is what every other text and Parquet file is.

    Raises:
        FlightLogError: for a file that cannot be read, that is empty, that stands for another one, or whose name
            promises a format that it does not have.
    """
    if path.is_dir():
        for reader in readers.values():
            if reader.folders(path):
                return reader
    first_bytes(path)  # refuses what is no file
    try:
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
    except OSError as error:
        raise FlightLogError(f"{path} cannot be read ({error.strerror or error}): give a log") from error
    if head.startswith(_POINTER):
        raise FlightLogError(
            f"{path.name} is a pointer of git-lfs and not the log itself: fetch it with git lfs pull, or download it"
        )
    fitting = [reader for reader in readers.values() if reader.recognizes(head)]
    suffix = path.suffix.lower()
    named = [reader for reader in readers.values() if suffix in reader.suffixes]
    both = [reader for reader in fitting if reader in named]
    if both or fitting:
        return (both or fitting)[0]
    if named and head:
        raise FlightLogError(
            f"{path.name} is no {named[0].name} although it is named so (it begins with {head[:8]!r}): copy it from "
            "the vehicle again"
        )
    return None


def _loaded(entry: EntryPoint) -> Any:
    try:
        return entry.load()
    except Exception as error:  # whatever somebody else's file may raise
        cause = " ".join(f"{type(error).__name__}: {error}".split())
        raise ValueError(f"the reader in the entry point {entry.value} cannot be read ({cause}): mend it") from error


def _with(known: dict[str, Reader], reader: Any, where: str) -> dict[str, Reader]:
    if not isinstance(reader, Reader):
        raise ValueError(f"{reader!r} in {where} is no Reader: name one")
    if reader.name in known:
        raise ValueError(f"reader {reader.name!r} in {where}: there is one of that name already: rename it")
    return {**known, reader.name: reader}
