"""Telemetry of a ground station, ``.tlog``: MAVLink packets, each behind the time at which it was received.

Packets that are not needed are skipped by their length; pymavlink decodes the others and checks their sums.
"""

import struct
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from auv_torchrl.flightlog.findings import Finding, Severity
from auv_torchrl.flightlog.readers.ardupilot import mavlink
from auv_torchrl.flightlog.readers.bounds import Loss
from auv_torchrl.flightlog.readers.reader import library
from auv_torchrl.flightlog.streams.stream import ReadOptions, Streams
from auv_torchrl.quantities import counted

_V1, _V2 = 0xFE, 0xFD  # how a packet begins
_STAMP = 8  # bytes of the time in us before each packet, highest first
_OVERHEAD = {_V1: 8, _V2: 12}  # bytes of head and sum
_SIGNATURE, _SIGNED = 13, 1
_YEARS_US = (1e15, 4e15)  # 2001 to 2096: what a time must be
_LONGEST = _STAMP + 255 + 12 + _SIGNATURE
_BLOCK = 4 << 20  # bytes


def recognizes(head: bytes) -> bool:
    """Whether a file begins with a time and a packet."""
    if len(head) < _STAMP + 3 or head[_STAMP] not in (_V1, _V2):
        return False
    return _YEARS_US[0] < struct.unpack(">Q", head[:_STAMP])[0] < _YEARS_US[1]


@np.errstate(invalid="ignore", over="ignore")  # of numbers in a damaged file
def read(path: Path, options: ReadOptions) -> Streams:
    """The streams of the vehicle of a telemetry file; of several, the one that the options name.

    Raises:
        FlightLogError: if pymavlink is missing, or there is no vehicle, or several.
    """
    dialect = library("pymavlink.dialects.v20.ardupilotmega", f"telemetry ({path.name})")
    numbers = {number for number, kind in dialect.mavlink_map.items() if _name(kind) in mavlink.WANTED}
    decoder = dialect.MAVLink(None)
    decoder.robust_parsing = False
    loss = Loss()
    received = mavlink.Received(loss)
    lost: Counter[str] = Counter()
    for stamp, packet in _packets(path, numbers, lost):
        try:
            message = decoder.decode(packet)
            if message.get_srcComponent() == mavlink.AUTOPILOT:
                received.add(message.get_srcSystem(), message.get_type(), stamp * 1e-6, message.to_dict())
        except (dialect.MAVError, struct.error, ValueError, TypeError, OverflowError):
            lost["packets"] += 1
        if loss.stopped:
            break
    return received.streams(path.name, "MAVLink telemetry", options.system, (*_damage(lost), *loss.findings()))


def _name(kind) -> str:
    return getattr(kind, "msgname", None) or kind.name


def _damage(lost: Counter) -> Iterator[Finding]:
    if lost["packets"] or lost["bytes"] > _LONGEST:
        sentence = (
            f"left out: {counted(lost['packets'], 'broken packet')}, {counted(lost['bytes'], 'byte')} between packets"
        )
        yield Finding(Severity.INFO, "broken_packets", sentence)


def _packets(path: Path, wanted: set[int], lost: Counter) -> Iterator[tuple[int, bytearray]]:
    """Times in us and packets of the numbers ``wanted``."""
    with path.open("rb") as file:
        data, at, more = b"", 0, True
        while True:
            if more and len(data) - at < _LONGEST:
                block = file.read(_BLOCK)
                data, at, more = data[at:] + block, 0, bool(block)
            if len(data) - at < _STAMP + 8:
                lost["bytes"] += len(data) - at
                return
            size, number = _frame(data, at + _STAMP)
            end = at + _STAMP + size
            stamp = int.from_bytes(data[at : at + _STAMP], "big")
            if not size or end > len(data) or not _YEARS_US[0] < stamp < _YEARS_US[1]:
                lost["bytes"] += 1
                at += 1
                continue
            if number in wanted:
                yield stamp, bytearray(data[at + _STAMP : end])
            at = end


def _frame(data: bytes, at: int) -> tuple[int, int]:
    """Length and number of the message of the packet at ``at``; 0 where there is none."""
    magic = data[at]
    if magic == _V2 and at + 10 <= len(data):
        signature = _SIGNATURE if data[at + 2] & _SIGNED else 0
        return data[at + 1] + _OVERHEAD[_V2] + signature, int.from_bytes(data[at + 7 : at + 10], "little")
    return (data[at + 1] + _OVERHEAD[_V1], data[at + 5]) if magic == _V1 else (0, 0)
