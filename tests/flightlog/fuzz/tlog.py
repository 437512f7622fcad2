"""Telemetry: what firmware sent, with fields of any bytes under a sum that is right, and packets of any kind."""

import struct
from functools import cache
from typing import Any, NamedTuple

import pytest
from hypothesis import strategies as st

from auv_torchrl.flightlog.readers.ardupilot.mavlink import WANTED
from tests.flightlog.fuzz.damage import MOST, Draw, Log, bytes_altered, chance, named, place, reordered
from tests.flightlog.fuzz.values import raw, sizes
from tests.flightlog.shared_data import EXCERPTS

_FIELDS = st.one_of(  # the bytes of a field: no number, none that is finite, the largest, nothing, a text
    st.sampled_from([b"\xff" * 8, b"\0" * 8, b"\x7f" * 8, b"\x80" * 8, struct.pack("<d", float("nan"))]),
    st.sampled_from([float("nan"), float("inf"), -float("inf"), 1e38, -1e38]).map(
        lambda value: struct.pack("<f", value)
    ),
    raw,
)
_FIRST = 700  # packets of the excerpt beside its parameters
_EVERY = 3


class Packet(NamedTuple):
    """A message with the time at which it was received in us."""

    stamp: int
    number: int
    system: int
    component: int
    payload: bytes


def _dialect() -> Any:
    return pytest.importorskip("pymavlink.dialects.v20.ardupilotmega")


def _sum(data: bytes) -> int:
    """The checksum X.25 of MAVLink."""
    value = 0xFFFF
    for byte in data:
        mixed = byte ^ (value & 0xFF)
        mixed = (mixed ^ (mixed << 4)) & 0xFF
        value = (value >> 8) ^ (mixed << 8) ^ (mixed << 3) ^ (mixed >> 4)
    return value


def _sealed(packet: Packet, old: bool = False) -> bytes:
    """The packet with a sum that is right, of MAVLink 2 or of the ``old`` one."""
    payload = packet.payload[:255]
    if old:
        inner = bytes((len(payload), 0, packet.system, packet.component, packet.number % 256)) + payload
    else:
        number = (packet.number % 2**24).to_bytes(3, "little")
        inner = bytes((len(payload), 0, 0, 0, packet.system, packet.component)) + number + payload
    kind = _dialect().mavlink_map.get(packet.number)
    total = _sum(inner + bytes((kind.crc_extra if kind else 0,)))
    stamp = struct.pack(">Q", packet.stamp % 2**64)
    return stamp + (b"\xfe" if old else b"\xfd") + inner + struct.pack("<H", total)


@cache
def _sound() -> tuple[tuple[Packet, bytes], ...]:
    """Packets of the excerpt, and each as it is in the file."""
    data, found, at, count = (EXCERPTS / "ardusub.tlog").read_bytes(), [], 0, 0
    wanted = {kind.id for kind in _dialect().mavlink_map.values() if kind.msgname in WANTED}
    while at + 20 <= len(data):
        (stamp,) = struct.unpack_from(">Q", data, at)
        frame = at + 8
        size = data[frame + 1]
        new = data[frame] == 0xFD
        head, overhead = (10, 12) if new else (6, 8)
        number = int.from_bytes(data[frame + 7 : frame + 10], "little") if new else data[frame + 5]
        system, component = data[frame + 5 : frame + 7] if new else data[frame + 3 : frame + 5]
        end = frame + size + overhead
        packet = Packet(stamp, number, system, component, data[frame + head : frame + head + size])
        count += 1
        if number in wanted and (count < _FIRST or count % _EVERY == 0):
            found.append((packet, data[at:end]))
        at = end
    return tuple(found)


def _changed(draw: Draw, packet: Packet) -> Packet:
    match draw(st.sampled_from(("field", "field", "field", "payload", "short", "long", "number", "system", "stamp"))):
        case "field":
            kind = _dialect().mavlink_map.get(packet.number)
            offset = place(draw, kind.unpacker.size if kind else 8)
            new = draw(_FIELDS)
            payload = packet.payload.ljust(kind.unpacker.size if kind else 8, b"\0")
            return packet._replace(payload=payload[:offset] + new + payload[offset + len(new) :])
        case "payload":
            return packet._replace(payload=draw(st.binary(max_size=60)))
        case "short":
            return packet._replace(payload=packet.payload[: place(draw, len(packet.payload))])
        case "long":
            return packet._replace(payload=packet.payload + draw(raw))
        case "number":
            return packet._replace(number=draw(st.integers(0, 300) | sizes))
        case "system":
            return packet._replace(system=draw(st.integers(0, 255)), component=draw(st.integers(0, 255)))
    return packet._replace(stamp=draw(sizes | st.just(packet.stamp + 10**9) | st.just(packet.stamp - 10**10)))


@st.composite
def _contents(draw: Draw) -> bytes:
    sound = list(_sound())
    pieces = [piece for _, piece in sound]
    old = chance(draw, 4)
    for _ in range(draw(st.integers(1, 3 * MOST)) if not chance(draw, 3) else 0):
        i = place(draw, len(sound))
        if chance(draw, 4):  # the same in all messages of this kind
            like, changed = sound[i][0], _changed(draw, sound[i][0])
            pieces = [
                _sealed(changed._replace(stamp=p.stamp), old) if p.number == like.number else piece
                for (p, _), piece in zip(sound, pieces, strict=True)
            ]
        else:
            pieces[i] = _sealed(_changed(draw, sound[i][0]), old)
    return bytes_altered(draw, b"".join(reordered(draw, pieces)))


def logs() -> st.SearchStrategy[Log]:
    """Telemetry files."""
    return named((".tlog", ".bin", ""), _contents())
