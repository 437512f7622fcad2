"""What the firmware said and wrote once: an exchange of packets, and the logs of two dives.

The exchange holds each servo packet as it came and each answer to 1e-5 of its unit, from the first frame on.
"""

import json
import lzma
from collections.abc import Iterator, Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from auv_torchrl.files import write_whole
from auv_torchrl.link.protocol import Reading, parse
from auv_torchrl.paths import PROJECT

FOLDER = PROJECT / "tests" / "link" / "recorded"
ABOUT, EXCHANGE = "dives.json", "exchange.npz.xz"
UNIT = 1e-5
_BACK = 2  # times that answers are differenced: of a motion little is left then


class Recorder:
    """Keeps what goes both ways."""

    def __init__(self) -> None:
        self._servos: list[tuple[int, ...]] = []
        self._answers: list[tuple[float, ...]] = []

    def add(self, packet: bytes, reading: Reading) -> None:
        """A packet was answered by a reading."""
        servos = parse(packet)
        assert servos is not None
        self._servos.append((servos.rate_hz, servos.frame, *servos.pwm))
        self._answers.append(tuple(np.hstack(reading).tolist()))

    def write(self, path: Path) -> None:
        """Write them, packed."""
        servos = np.diff(np.array(self._servos, dtype=np.int32), axis=0, prepend=0)
        answers = np.round(np.array(self._answers) / UNIT).astype(np.int64)
        for _ in range(_BACK):
            answers = np.diff(answers, axis=0, prepend=0)
        plain = BytesIO()
        # column by column: numbers of one kind pack better side by side
        np.savez(plain, servos=servos.T.astype(np.int32), answers=answers.T.astype(np.int32))
        write_whole(path, lzma.compress(plain.getvalue(), preset=9))


def read_exchange(path: Path = FOLDER / EXCHANGE) -> tuple[np.ndarray, np.ndarray]:
    """Servo packets (T, 18), rate, frame and pulses; and answers (T, 17) as in ``Reading``."""
    with np.load(BytesIO(lzma.decompress(path.read_bytes()))) as packed:
        servos, answers = packed["servos"].T.astype(np.int64), packed["answers"].T.astype(np.int64)
    for _ in range(_BACK):
        answers = np.cumsum(answers, axis=0)
    return np.cumsum(servos, axis=0), answers * UNIT


def unpack(vehicle: str, scenario: str | None, set_first: Mapping[str, float], to: Path) -> None:
    """Unpack the recorded log of the dive whose name ``to`` has.

    Raises:
        ValueError: for one that is not recorded, naming those that are.
    """
    recorded: dict[str, Any] = json.loads((FOLDER / ABOUT).read_text(encoding="utf-8"))
    asked = {"vehicle": vehicle, "scenario": scenario, "set": dict(set_first)}
    if recorded.get(to.name) != asked:
        known = "; ".join(f"{name} of {one}" for name, one in recorded.items())
        raise ValueError(
            f"{to.name} of {asked} is not recorded (there are {known}): fly it, with ARDUSUB and without --recorded"
        )
    write_whole(to, lzma.decompress((FOLDER / f"{to.name}.xz").read_bytes()))


_HEAD, _FMT, _FMT_LENGTH = (
    b"\xa3\x95",
    128,
    89,
)  # of a message of a DataFlash log; the message that describes another one


def thinned(log: bytes, kept: frozenset[str]) -> bytes:
    """A DataFlash log with the messages of some names alone, as the firmware wrote them, and what describes these."""
    return b"".join(
        message
        for name, message in messages(log)
        if name in kept or (name == "FMT" and (message[3] == _FMT or _name(message) in kept))
    )


def messages(log: bytes) -> Iterator[tuple[str, bytes]]:
    """The messages of a DataFlash log with their names; the last one may be broken off.

    Raises:
        ValueError: where the log does not hold one message behind the other.
    """
    lengths, names, at = {_FMT: _FMT_LENGTH}, {_FMT: "FMT"}, 0
    while at + 3 <= len(log):
        kind = log[at + 2]
        if log[at : at + 2] != _HEAD or kind not in lengths:
            raise ValueError(f"no message begins at byte {at}")
        message = log[at : at + lengths[kind]]
        if kind == _FMT and len(message) == _FMT_LENGTH:
            lengths[message[3]], names[message[3]] = message[4], _name(message)
        yield names[kind], message
        at += lengths[kind]


def _name(message: bytes) -> str:
    """Of the messages that one of kind FMT describes."""
    return message[5:9].rstrip(b"\0").decode("ascii")
