"""The few messages of MAVLink that a flight needs, as bytes and back: https://mavlink.io/en/guide/serialization.html.

pymavlink has all messages of all dialects, and takes 93 MB for them; a test holds this table to it.
"""

import struct
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

V1, V2 = 0xFE, 0xFD  # first byte of a packet
_HEAD = {V1: 6, V2: 10}  # bytes
_SUM, _SIGNATURE, _SIGNED = 2, 13, 1
_KNOWN_FLAGS = _SIGNED  # a packet with another incompatible flag must not be read
_MOST_WAITING = 4096  # bytes that are kept for a packet that is not whole yet; the longest has 280


class Layout(NamedTuple):
    """One message: its number, the byte that its sum is seeded with, and its fields in the order of the wire."""

    number: int
    seed: int
    format: str  # of struct
    fields: tuple[str, ...]


class Message(NamedTuple):
    """A message that came."""

    name: str
    system: int
    component: int
    fields: Mapping[str, Any]


def _layout(number: int, seed: int, form: str, fields: str) -> Layout:
    return Layout(number, seed, "<" + form, tuple(fields.split()))


_AXES = "roll pitch yaw rollspeed pitchspeed yawspeed"
LAYOUTS = {
    "HEARTBEAT": _layout(0, 50, "IBBBBB", "custom_mode type autopilot base_mode system_status mavlink_version"),
    "SET_MODE": _layout(11, 89, "IBB", "custom_mode target_system base_mode"),
    "PARAM_REQUEST_READ": _layout(20, 214, "hBB16s", "param_index target_system target_component param_id"),
    "PARAM_VALUE": _layout(22, 220, "fHH16sB", "param_value param_count param_index param_id param_type"),
    "PARAM_SET": _layout(23, 168, "fBB16sB", "param_value target_system target_component param_id param_type"),
    "ATTITUDE": _layout(30, 39, "Iffffff", f"time_boot_ms {_AXES}"),
    "LOCAL_POSITION_NED": _layout(32, 185, "Iffffff", "time_boot_ms x y z vx vy vz"),
    "MANUAL_CONTROL": _layout(69, 243, "hhhhHB", "x y z r buttons target"),
    "RC_CHANNELS_OVERRIDE": _layout(
        70, 124, "8HBB", " ".join(f"chan{n}_raw" for n in range(1, 9)) + " target_system target_component"
    ),
    "COMMAND_LONG": _layout(
        76, 152, "7fHBBB",
        " ".join(f"param{n}" for n in range(1, 8)) + " command target_system target_component confirmation",
    ),
    "COMMAND_ACK": _layout(77, 143, "HB", "command result"),
    "VISION_POSITION_ESTIMATE": _layout(102, 158, "Qffffff", "usec x y z roll pitch yaw"),
    "AUTOPILOT_VERSION": _layout(148, 178, "QQI", "capabilities uid flight_sw_version"),
    "NAMED_VALUE_FLOAT": _layout(251, 170, "If10s", "time_boot_ms value name"),
    "STATUSTEXT": _layout(253, 83, "B50s", "severity text"),
    "ODOMETRY": _layout(
        331, 91, "Q3f4f3f3f21f21fBB",
        "time_usec x y z qw qx qy qz vx vy vz rollspeed pitchspeed yawspeed "
        + " ".join(f"pose_{n}" for n in range(21)) + " " + " ".join(f"speed_{n}" for n in range(21))
        + " frame_id child_frame_id",
    ),
}  # fmt: skip
_BY_NUMBER = {layout.number: name for name, layout in LAYOUTS.items()}


def checksum(data: bytes, seed: int) -> int:
    """CRC-16/MCRF4XX of the bytes and of the seed behind them."""
    crc = 0xFFFF
    for byte in (*data, seed):
        byte ^= crc & 0xFF
        byte = (byte ^ (byte << 4)) & 0xFF
        crc = (crc >> 8) ^ (byte << 8) ^ (byte << 3) ^ (byte >> 4)
    return crc


def packet(name: str, system: int, component: int, sequence: int = 0, **fields: Any) -> bytes:
    """A message as MAVLink 2. Texts are ``bytes``; a field that is left out is 0.

    Raises:
        ValueError: for a field that the message does not have.
    """
    layout = LAYOUTS[name]
    if unknown := set(fields) - set(layout.fields):
        raise ValueError(f"{name} has no {', '.join(sorted(unknown))}: there are {', '.join(layout.fields)}")
    texts = {field for field, kind in zip(layout.fields, _kinds(layout.format), strict=True) if kind == "s"}
    values = [fields.get(field, b"" if field in texts else 0) for field in layout.fields]
    payload = struct.pack(layout.format, *values).rstrip(b"\0") or b"\0"
    head = struct.pack("<BBBBBBHB", len(payload), 0, 0, sequence & 0xFF, system, component,
                       layout.number & 0xFFFF, layout.number >> 16)  # fmt: skip
    return bytes((V2,)) + head + payload + checksum(head + payload, layout.seed).to_bytes(2, "little")


def _kinds(form: str) -> Iterator[str]:
    """The type of each field of a format of struct."""
    count = ""
    for sign in form.lstrip("<"):
        if sign.isdigit():
            count += sign
        else:
            yield from sign if sign == "s" else sign * int(count or 1)
            count = ""


class Parser:
    """Cuts bytes as they come into messages; what is none of ours, damaged or another message is left out."""

    def __init__(self) -> None:
        self._waiting = bytearray()
        self.damaged = 0  # packets of known messages whose sum is wrong

    def feed(self, data: bytes) -> list[Message]:
        """The messages that are whole now."""
        self._waiting += data
        found, at, waiting = [], 0, self._waiting
        while (size := self._size(at)) and at + size <= len(waiting):
            message, used = self._read(bytes(waiting[at : at + size]))
            at += used
            if message is not None:
                found.append(message)
            at = self._next_start(at)
        at = self._next_start(at)
        del waiting[:at]
        if len(waiting) > _MOST_WAITING:
            waiting.clear()
        return found

    def _next_start(self, at: int) -> int:
        waiting = self._waiting
        while at < len(waiting) and waiting[at] not in _HEAD:
            at += 1
        return at

    def _size(self, at: int) -> int:
        """Bytes of the packet that begins there; 0 where its head is not whole."""
        waiting = self._waiting
        if at >= len(waiting):
            return 0
        magic = waiting[at]
        if magic not in _HEAD:
            return 1
        if at + _HEAD[magic] > len(waiting):
            return 0
        signature = _SIGNATURE if magic == V2 and waiting[at + 2] & _SIGNED else 0
        return _HEAD[magic] + waiting[at + 1] + _SUM + signature

    def _read(self, data: bytes) -> tuple[Message | None, int]:
        """The message of a packet, if it is one of ours, and how many bytes are done with."""
        magic, length = data[0], data[1] if len(data) > 1 else 0
        if magic not in _HEAD:
            return None, 1
        if magic == V2:
            number, system, component = int.from_bytes(data[7:10], "little"), data[5], data[6]
        else:
            number, system, component = data[5], data[3], data[4]
        name = _BY_NUMBER.get(number)
        if name is None:
            return None, len(data)  # its seed is not known: it is taken for whole
        head, layout = _HEAD[magic], LAYOUTS[name]
        sent = int.from_bytes(data[head + length : head + length + _SUM], "little")
        if checksum(data[1 : head + length], layout.seed) != sent or (magic == V2 and data[2] & ~_KNOWN_FLAGS):
            self.damaged += 1
            return None, 1
        size = struct.calcsize(layout.format)
        payload = data[head : head + length][:size].ljust(size, b"\0")
        fields = dict(zip(layout.fields, struct.unpack(layout.format, payload), strict=True))
        return Message(name, system, component, fields), len(data)


def text_of(value: bytes) -> str:
    """A text field as a string, without what fills it up; signs that are no ASCII are replaced."""
    return value.split(b"\0")[0].decode("ascii", "replace")
