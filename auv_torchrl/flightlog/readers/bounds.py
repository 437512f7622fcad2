"""How much a file may become in memory, and what is left out of it beyond that.

A hostile or damaged file of 50 kB can claim an array of gigabytes, or unpack to them. Readers therefore take content
piece by piece, skip what is larger than anything that they need, and stop where the values would fill the memory. A
:class:`Loss` collects what that leaves out, and its findings name it.
"""

import io
from array import array
from collections import Counter
from collections.abc import Iterator
from typing import IO, Any

import numpy as np

from auv_torchrl.flightlog.findings import Finding, Severity
from auv_torchrl.quantities import counted
from auv_torchrl.text import printable

MIB = 1 << 20
MOST_CHUNK = 256 * MIB  # bytes that one chunk may unpack to; recorders write chunks of 1 to 16 MiB
MOST_MESSAGE = 64 << 10  # bytes; the largest message that is needed, an Odometry, has 0.7 kB, as JSON some kB
MOST_VALUES = 24_000_000  # numbers that are held of a file, 8 bytes each, copied some times over while in use
MOST_TEXTS = 50_000  # messages with texts that are held; a vehicle has 1,500 parameters and sends them a few times
MOST_RECORDS = 20_000_000  # of a recording that are looked at: 11 h at 500 Hz
MOST_NAME = 1000  # characters of the name of a topic or of a type
_LEAST_UNPACKED = 2048 * MIB  # bytes that any file may unpack to in all,
_MOST_RATIO = 20  # and times its own size that a large one may; JSON of telemetry shrinks by 10
_BLOCK = MIB
_LISTED = 3  # kinds of damage that a finding quotes


def most_unpacked(size: int) -> int:
    """Bytes that the content of a file of ``size`` bytes may unpack to."""
    return max(_LEAST_UNPACKED, _MOST_RATIO * size)


class Loss:
    """What is left out of a file while it is read."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()
        self._beyond: Counter[str] = Counter()
        self._stopped = ""
        self._passed = 0

    def add(self, kind: str, count: int = 1) -> None:
        """Note something that is left out, such as "messages that cannot be read"."""
        self._counts[kind] += count

    def beyond(self, kind: str) -> None:
        """Note something that is sound and left out because it is more than a log needs."""
        self._beyond[kind] += 1

    def cut(self, kind: str, error: Exception | None = None) -> None:
        """Note damage that is said once, with what the library says of it."""
        cause = "" if error is None else f" ({printable(' '.join(f'{type(error).__name__}: {error}'.split()), 100)})"
        self._counts[f"{kind}{cause}"] = 0

    def stop(self, reason: str) -> None:
        """Note that the rest of the file is not read."""
        self._stopped = self._stopped or reason

    def look(self) -> None:
        """Count a record that is looked at."""
        self._passed += 1
        if self._passed > MOST_RECORDS:
            self.stop(f"it holds more than {MOST_RECORDS:,} records")

    @property
    def stopped(self) -> bool:
        """Whether the rest of the file is not read."""
        return bool(self._stopped)

    @property
    def sentence(self) -> str:
        """What is left out for damage; empty where that is nothing."""
        parts = [f"{kind} ({count:,})" if count else kind for kind, count in self._counts.items()]
        more = [f"{counted(len(parts) - _LISTED, 'more kind', 'more kinds')} of damage"] if len(parts) > _LISTED else []
        return "; ".join([*parts[:_LISTED], *more])

    def findings(self) -> Iterator[Finding]:
        """What a reader of the log should know of it."""
        if self.sentence:
            sentence = f"the file is cut or damaged; left out: {self.sentence}"
            yield Finding(Severity.WARNING, "damaged_file", sentence, "Copy it from the vehicle again")
        if self._beyond:
            larger = "; ".join(f"{kind} ({count:,})" for kind, count in self._beyond.most_common(_LISTED))
            yield Finding(Severity.WARNING, "too_large", f"left out because it is more than a log needs: {larger}")
        if self._stopped:
            remedy = "Give a part of the file for the rest"
            yield Finding(Severity.WARNING, "too_large", f"the rest of the file is not read: {self._stopped}", remedy)


class Budget:
    """How many values may still be taken of a file."""

    def __init__(self, loss: Loss) -> None:
        self._left = MOST_VALUES
        self._loss = loss

    def take(self, count: int) -> bool:
        """Whether there is room for so many; where there is none, the rest of the file is not read."""
        self._left -= count
        if self._left < 0:
            self._loss.stop(f"it holds more than {MOST_VALUES:,} numbers")
        return self._left >= 0


class Rows:
    """Rows of numbers of one width, 8 bytes each."""

    def __init__(self, width: int) -> None:
        self.width = width
        self._values = array("d")

    def __len__(self) -> int:
        return len(self._values) // max(self.width, 1)

    def add(self, row) -> None:
        """Append a row.

        Raises:
            OverflowError: for a whole number that is no float64.
            TypeError: for what is no number.
            ValueError: for another width.
        """
        values = array("d", row)
        if len(values) != self.width:
            raise ValueError(f"{counted(len(values), 'value')} where there were {self.width}")
        self._values.extend(values)

    def array(self) -> np.ndarray:
        """(T, width) float64, without a copy: no row can be added while it is in use."""
        return np.frombuffer(self._values, np.float64).reshape(-1, self.width)


class Part(io.RawIOBase):
    """Some bytes of an open file, as a file of their own."""

    def __init__(self, file: IO[bytes], size: int) -> None:
        self._file, self._left = file, size

    def readable(self) -> bool:
        """As the protocol of files asks."""
        return True

    def readinto(self, buffer) -> int:
        """Fill the buffer with the next bytes."""
        data = self._file.read(min(len(buffer), self._left))
        self._left -= len(data)
        buffer[: len(data)] = data
        return len(data)


class Limited(io.RawIOBase):
    """What an unpacker gives, up to a number of bytes; ``damage`` is what stopped it before its end."""

    def __init__(self, source: Any, most: int, errors: tuple[type[Exception], ...]) -> None:
        self._read = source.read1  # one step of the unpacker: what came before damage is not lost with it
        self._most, self._errors = most, errors
        self.count = 0
        self.damage: Exception | None = None
        self.full = False

    def readable(self) -> bool:
        """As the protocol of files asks."""
        return True

    def readinto(self, buffer) -> int:
        """Fill the buffer with the next bytes."""
        if self.damage is not None or self.full:
            return 0
        try:
            data = self._read(min(len(buffer), _BLOCK))
        except self._errors as error:
            self.damage = error
            return 0
        if self.count + len(data) > self._most:
            self.full = True
            data = data[: self._most - self.count]
        self.count += len(data)
        buffer[: len(data)] = data
        return len(data)


def skip(file: IO[bytes], count: int) -> bool:
    """Leave out bytes of a file that cannot be sought; whether they were there."""
    while count > 0:
        data = file.read(min(count, _BLOCK))
        if not data:
            return False
        count -= len(data)
    return True
