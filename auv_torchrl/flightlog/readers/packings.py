"""What takes packed bytes apart piece by piece: around a whole file, or around a chunk of one."""

import bz2
import gzip
import io
import lzma
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import IO, Any, NamedTuple

from auv_torchrl.flightlog.readers.bounds import MIB, MOST_CHUNK, Limited, Loss, most_unpacked
from auv_torchrl.flightlog.readers.reader import library

_WINDOW = 128 << 20  # bytes, the most that zstd may ask for to look back; its own tools refuse more, too

DAMAGED = "damaged chunks, from the damage on"

Errors = tuple[type[Exception], ...]


class Packing(NamedTuple):
    """One way of packing bytes."""

    name: str
    suffixes: tuple[str, ...]
    magic: bytes
    opened: Callable[[IO[bytes], str], tuple[Any, Errors]]  # a file, and for whom; what reads it, what that may raise


def _gzip(file: IO[bytes], needed_for: str) -> tuple[Any, Errors]:
    return gzip.GzipFile(fileobj=file, mode="rb"), (OSError, EOFError, zlib.error)


def _xz(file: IO[bytes], needed_for: str) -> tuple[Any, Errors]:
    return lzma.LZMAFile(file), (OSError, EOFError, lzma.LZMAError)


def _bzip2(file: IO[bytes], needed_for: str) -> tuple[Any, Errors]:
    return bz2.BZ2File(file), (OSError, EOFError, ValueError)


def _zstd(file: IO[bytes], needed_for: str) -> tuple[Any, Errors]:
    module = library("zstandard", needed_for)
    unpacker = module.ZstdDecompressor(max_window_size=_WINDOW)
    return unpacker.stream_reader(file, read_across_frames=True), (OSError, EOFError, module.ZstdError)


def _lz4(file: IO[bytes], needed_for: str) -> tuple[Any, Errors]:
    return library("lz4.frame", needed_for).LZ4FrameFile(file), (OSError, EOFError, RuntimeError)


PACKINGS = {
    packing.name: packing
    for packing in (
        Packing("gzip", (".gz",), b"\x1f\x8b\x08", _gzip),
        Packing("xz", (".xz",), b"\xfd7zXZ\0", _xz),
        Packing("bzip2", (".bz2",), b"BZh", _bzip2),
        Packing("zstd", (".zst", ".zstd"), b"\x28\xb5\x2f\xfd", _zstd),
        Packing("lz4", (".lz4",), b"\x04\x22\x4d\x18", _lz4),
    )
}


class Chunks:
    """The chunks of a file, unpacked piece by piece, each and all of them up to a bound."""

    def __init__(self, size: int, loss: Loss) -> None:
        self._room = most_unpacked(size)
        self._loss = loss

    @contextmanager
    def opened(self, packed: IO[bytes], packing: str, size: int) -> Iterator[IO[bytes]]:
        """What is in a chunk; what is left out of it is noted behind it.

        Args:
            packed: its bytes.
            packing: a key of :data:`PACKINGS`, or nothing for a chunk that is not packed.
            size: bytes that it says it becomes.
        """
        source, errors = packed, ()
        if packing:
            source, errors = PACKINGS[packing].opened(packed, f"a chunk packed by {packing}")
        most = min(MOST_CHUNK, self._room)
        limited = Limited(source, most, errors)
        yield io.BufferedReader(limited, MIB)
        self._room -= limited.count
        if limited.damage is not None or (limited.count < size and not limited.full and not self._loss.stopped):
            self._loss.add(DAMAGED)
        if limited.full and most < MOST_CHUNK:
            self._loss.stop("it unpacks to more than any recording does")
        elif limited.full:
            self._loss.beyond(f"chunks beyond their first {MOST_CHUNK // MIB} MiB")
