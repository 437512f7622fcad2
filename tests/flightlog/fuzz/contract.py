"""Reads a log as the commands do: whatever it holds, a result or one printable line, in bounded memory and time."""

import contextlib
import io
import resource
import signal
import unicodedata
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from auv_torchrl.flightlog import FlightLogError, read_flightlog
from auv_torchrl.flightlog.job import info
from auv_torchrl.flightlog.streams import ReadOptions
from auv_torchrl.vehicle import load_vehicle
from tests.flightlog.dataflash_writer import ALL
from tests.flightlog.fuzz.damage import Log

MOST_BYTES = 1_000_000_000  # that reading may add to a process, which has up to 0.5 GB before; 1.5 GB is the limit
MOST_S = 20.0  # CPU time for a log of less than a megabyte
LONGEST = 1000  # characters of an error
_STATUS = Path("/proc/self/status")
_RESET = Path("/proc/self/clear_refs")

VEHICLE = load_vehicle("bluerov2_heavy")


class TooSlow(BaseException):
    """Reading goes on for longer than :data:`MOST_S`; no ``Exception``, which a reader of a library could catch."""


def written(log: Log, folder: Path) -> Path:
    """The path of a log that is put into a folder."""
    path = folder / log.name
    if isinstance(log.content, bytes):
        path.write_bytes(log.content)
    else:
        path.mkdir()
        for name, content in log.content.items():
            (path / name).write_bytes(content)
    return path


def read_or_refuse(path: Path) -> str:
    """Read a log twice, as ``auv-log info`` and as the diagnosis do; says of each whether it was read or refused.

    Everything that is printed and every message has to be printable, and an error has one line.
    """
    with within_bounds():
        said = io.StringIO()
        try:
            with contextlib.redirect_stdout(said):
                info([path], ReadOptions())
            seen = "read"
        except FlightLogError as error:
            check_error(error)
            seen = "refused"
        for line in said.getvalue().removesuffix("\n").split("\n"):
            assert shows(line), f"not printable: {line!r}"
        try:
            log = read_flightlog(path, VEHICLE, options=ReadOptions(parameters=ALL))
        except FlightLogError as error:
            check_error(error)
            return f"{seen}, no rows"
    check_log(log)
    return f"{seen}, rows"


def shows(text: str) -> bool:
    """Whether a text is one line of characters that are there to look at; spaces may be of any width."""
    return text.isprintable() or all(c.isprintable() or unicodedata.category(c) == "Zs" for c in text)


def check_error(error: FlightLogError) -> None:
    """An error is one printable line that fits a screen."""
    message = str(error)
    assert message and shows(message), f"not one printable line: {message[:300]!r}"
    assert len(message) <= LONGEST, f"{len(message)} characters: {message[:300]!r}"


def check_log(log) -> None:
    """A log keeps its promises: rising times, finite commands within their limits, axes that are there or not."""
    assert log.episodes
    for finding in log.findings:
        assert shows(str(finding)), f"not printable: {finding!r}"
    for episode in log.episodes:
        assert (np.diff(episode.t) > 0).all()
        assert np.isfinite(episode.commands).all() and np.abs(episode.commands).max() <= 1
        measured = np.concatenate((episode.pose, episode.velocity), -1)
        assert (np.isfinite(measured).all(axis=0) | np.isnan(measured).all(axis=0)).all()
        assert len(episode.t) == len(episode.pose) == len(episode.velocity) == len(episode.commands)


@contextlib.contextmanager
def within_bounds() -> Iterator[None]:
    """Fails what allocates more than :data:`MOST_BYTES`, or computes for longer than :data:`MOST_S`.

    The kernel refuses memory far beyond the limit, so that a mistake costs this process and not the machine. That is a
    ``MemoryError``, which a library may catch: the peak is compared afterwards, too.
    """

    def stop(*_: object) -> None:
        raise TooSlow(f"longer than {MOST_S:.0f} s")

    before = peak_bytes(reset=True)
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    handler = signal.signal(signal.SIGVTALRM, stop)  # SIGALRM is pytest-timeout's
    if allocated := _status("VmData"):
        resource.setrlimit(resource.RLIMIT_DATA, (allocated + 2 * MOST_BYTES, hard))  # much that is claimed is not used
    signal.setitimer(signal.ITIMER_VIRTUAL, MOST_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, handler)
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))
    grown = peak_bytes() - before
    assert grown < MOST_BYTES, f"reading takes {grown / 1e9:.1f} GB"


def peak_bytes(reset: bool = False) -> int:
    """The most memory that this process held since the last reset; 0 where the system does not say."""
    if reset:
        with contextlib.suppress(OSError):  # where it cannot be set back, the peak is that of all logs before
            _RESET.write_text("5")
    return _status("VmHWM")


def _status(key: str) -> int:
    """A number of bytes that Linux says of this process."""
    if not _STATUS.is_file():
        return 0
    found = [line.split()[1] for line in _STATUS.read_text().splitlines() if line.startswith(f"{key}:")]
    return int(found[0]) * 1024 if found else 0
