"""A log that is packed by gzip, xz, bzip2, zstd, lz4 or zip: unpacked into a folder that is there while it is read.

It bears the name of the file that was given, so that all messages speak of that.
"""

import lzma
import shutil
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path, PurePosixPath
from typing import IO

from auv_torchrl.flightlog.findings import Finding, FlightLogError, Severity
from auv_torchrl.flightlog.readers.bounds import MIB, Limited
from auv_torchrl.flightlog.readers.packings import PACKINGS, Errors
from auv_torchrl.flightlog.readers.reader import HEAD_BYTES
from auv_torchrl.flightlog.tables.header import first_bytes
from auv_torchrl.quantities import counted
from auv_torchrl.text import in_order, printable

MOST_BYTES = 1024 * MIB  # that a packed log may become; a DataFlash log takes as much memory
_DEEPEST = 3  # packings around one log, such as a zip of a gz
_LISTED = 8  # members that a message names
_MOST_MEMBERS = 10_000  # of an archive; a card full of dives has hundreds
_ZIP, _ENTRY = b"PK\x03\x04", b"PK\x01\x02"  # a file, and an entry of the directory
_ENCRYPTED = 1  # of the flags of a member
_NOT_UNPACKED = {  # by the first bytes
    b"7z\xbc\xaf\x27\x1c": "by 7-Zip",
    b"Rar!": "by RAR",
    b"PK\x05\x06": "by zip, with nothing in it",
}
SUFFIXES = (*(suffix for packing in PACKINGS.values() for suffix in packing.suffixes), ".zip")
BAG = "metadata.yaml"  # in the folder of a bag of ROS 2, beside the files with its messages
STORAGE = tuple(f"{kind}{packed}" for kind in (".db3", ".mcap") for packed in ("", *SUFFIXES))
_ZIP_ERRORS = (zipfile.BadZipFile, zlib.error, lzma.LZMAError, OSError, EOFError, NotImplementedError, RuntimeError,
               struct.error, UnicodeError)  # fmt: skip

IsLog = Callable[[str, bytes], bool]  # whether a file of this name that begins with these bytes is a log


def bare(name: str) -> str:
    """The name of a file without the suffixes of packings."""
    while name.lower().endswith(SUFFIXES):
        name = name[: name.rindex(".")]
    return name


@contextmanager
def unpacked(path: Path, is_log: IsLog) -> Iterator[tuple[Path, tuple[Finding, ...]]]:
    """The log itself, and what there is to say of its packing; ``path`` where it is not packed.

    Args:
        path: the file.
        is_log: tells the logs among the members of an archive.

    Raises:
        FlightLogError: for a packing that cannot be opened, that holds no log or several, or that becomes too large.
    """
    name, findings = path.name, []
    with ExitStack() as stack:
        for depth in range(_DEEPEST + 1):
            if path.is_dir():
                break
            head = first_bytes(path, HEAD_BYTES)
            for magic, how in _NOT_UNPACKED.items():
                if head.startswith(magic):
                    raise FlightLogError(f"{name} is packed {how}: unpack it and give the log")
            packing = next((p for p in PACKINGS.values() if head.startswith(p.magic)), None)
            if packing is None and not head.startswith(_ZIP):
                break
            if depth == _DEEPEST:
                raise FlightLogError(f"{name} is packed more than {_DEEPEST} times over: unpack it and give the log")
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="auv-log-")))
            inner = folder / path.name
            if packing is None:
                damage = _unzip(path, inner, name, is_log)
            else:
                with path.open("rb") as file:
                    opened, errors = packing.opened(file, f"a log packed by {packing.name} ({name})")
                    damage = _copy(opened, errors, inner, name)
            if damage is not None:
                findings.append(_cut(name, inner, packing.name if packing else "zip", damage))
            path = inner
        yield path, tuple(findings)


def _copy(source: IO[bytes], errors: Errors, to: Path, name: str) -> Exception | None:
    """Write what an unpacker gives; what stopped it before its end, if anything.

    Raises:
        FlightLogError: for more than may be, and for a disk that is full.
    """
    limited = Limited(source, MOST_BYTES, errors)
    try:
        with to.open("wb") as out:
            shutil.copyfileobj(limited, out, MIB)
    except OSError as error:
        raise FlightLogError(
            f"{name} cannot be unpacked into {to.parent} ({error.strerror or error}): make room, or set TMPDIR"
        ) from error
    if limited.full:
        raise FlightLogError(
            f"{name} unpacks to more than {MOST_BYTES // MIB:,} MiB: unpack it, and give a part of the log"
        )
    return limited.damage


def _cut(name: str, inner: Path, packing: str, damage: Exception) -> Finding:
    """What is said of a packing that is damaged somewhere.

    Raises:
        FlightLogError: where nothing came before the damage.
    """
    cause = printable(" ".join(f"{type(damage).__name__}: {damage}".split()), 100)
    size = sum(part.stat().st_size for part in inner.iterdir()) if inner.is_dir() else inner.stat().st_size
    if not size:
        raise FlightLogError(f"{name} cannot be unpacked as {packing} ({cause}): copy it again") from damage
    sentence = f"{name} is cut or damaged; {packing} unpacked {counted(size, 'byte')} before it ({cause})"
    return Finding(Severity.WARNING, "damaged_packing", sentence, "Copy it again")


def _unzip(path: Path, inner: Path, name: str, is_log: IsLog) -> Exception | None:
    """Write the one log of a zip file, or the folder of one that is a bag of ROS 2; what damage there is, if any.

    Raises:
        FlightLogError: naming the members where none is a log, or several are.
    """
    if (count := _members(path)) > _MOST_MEMBERS:
        raise FlightLogError(f"{name} holds {counted(count, 'file')}: unpack it and give the log")
    try:
        with zipfile.ZipFile(path) as archive:
            chosen = _choose(archive, name, is_log)
            if len(chosen) > 1:
                inner.mkdir()
            damage = None
            for number, member in enumerate(chosen):
                # named by us: the name of a member may lead anywhere
                to = inner if len(chosen) == 1 else inner / f"{number:05d}{PurePosixPath(member.filename).suffix}"
                with archive.open(member) as source:
                    damage = _copy(source, _ZIP_ERRORS, to, name) or damage
            return damage
    except _ZIP_ERRORS as error:
        cause = printable(" ".join(f"{type(error).__name__}: {error}".split()), 100)
        raise FlightLogError(
            f"{name} is an Excel or ZIP file that cannot be opened ({cause}): export the log as CSV or Parquet, or "
            "unpack it"
        ) from error


def _members(path: Path) -> int:
    """How many files a zip file can hold: the entries of its directory, counted before they are read."""
    count, tail = 0, b""
    with path.open("rb") as file:
        while block := file.read(MIB):
            count += (tail + block).count(_ENTRY)
            tail = block[1 - len(_ENTRY) :]
    return count


def _choose(archive: zipfile.ZipFile, name: str, is_log: IsLog) -> list[zipfile.ZipInfo]:
    """The member that is a log, or the files of the one bag.

    Raises:
        FlightLogError: naming the members where none is a log, several are, or it needs a password.
    """
    members = [m for m in archive.infolist() if not m.is_dir() and not _hidden(m.filename)]
    names = [member.filename for member in members]
    if "[Content_Types].xml" in names:
        raise FlightLogError(f"{name} is an Excel or Word file: export the log as CSV or Parquet")
    if bags := [PurePosixPath(n).parent for n in names if PurePosixPath(n).name == BAG]:
        inside = [m for m in members if PurePosixPath(m.filename).parent == bags[0]]
        logs = [m for m in inside if PurePosixPath(m.filename).name.lower().endswith((BAG, *STORAGE))]
    else:
        logs = [m for m in members if len(members) == 1 or is_log(m.filename, _begin(archive, m))]
    if len(bags) > 1 or (not bags and len(logs) != 1):
        listed = ", ".join(printable(n, 60) for n in names[:_LISTED]) + (", ..." if len(names) > _LISTED else "")
        found = counted(max(len(bags), len(logs)), "log") if logs else "no log"
        raise FlightLogError(f"{name} holds {found} ({listed or 'nothing'}): unpack it and give one log")
    if any(member.flag_bits & _ENCRYPTED for member in logs):
        raise FlightLogError(f"{name} needs a password: unpack it and give the log")
    return sorted(logs, key=lambda member: in_order(member.filename))


def _hidden(name: str) -> bool:
    """Whether a member is what a system of files puts beside what people pack."""
    parts = PurePosixPath(name).parts
    return any(part == "__MACOSX" or (part.startswith(".") and part not in (".", "..")) for part in parts)


def _begin(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> bytes:
    """How a member begins; nothing for one that cannot be read."""
    if member.flag_bits & _ENCRYPTED:
        return b""
    try:
        with archive.open(member) as source:
            return source.read(HEAD_BYTES)
    except _ZIP_ERRORS:
        return b""  # it is no log by its content, but may be by its name
