"""PX4's logs: topics of other fields, types and sizes, nested in themselves, and messages of any kind."""

import struct
from functools import cache

import numpy as np
from hypothesis import strategies as st

from tests.flightlog.fuzz.damage import MOST, Draw, Log, bytes_altered, chance, named, place, reordered
from tests.flightlog.fuzz.values import floats, integers, raw, sizes, texts

_HEAD = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1_000_000)
_TOPICS = {
    "actuator_motors": "uint64_t timestamp;float[12] control;",
    "vehicle_attitude": "uint64_t timestamp;float[4] q;",
    "vehicle_status": "uint64_t timestamp;uint8_t arming_state;uint8_t nav_state;",
    "vehicle_local_position": "uint64_t timestamp;float x;float y;float z;float vx;float vy;float vz;bool xy_valid;"
    "bool z_valid;bool v_xy_valid;bool v_z_valid;",
    "sensor_combined": "uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2;",
    "battery_status": "uint64_t timestamp;float voltage_v;float current_a;",
}
_TYPES = (
    "float",
    "double",
    "int8_t",
    "uint8_t",
    "int32_t",
    "uint64_t",
    "bool",
    "char",
    "vehicle_attitude",
    "nothing",
    "",
)
_SYNC = struct.pack("<HB", 8, ord("S")) + bytes((0x2F, 0x73, 0x13, 0x20, 0x25, 0x0C, 0xBB, 0x12))

Message = tuple[str, bytes]  # kind and body


def _keyed(key: str, value: bytes) -> bytes:
    name = key.encode("utf-8", "surrogatepass")[:255]
    return bytes((len(name),)) + name + value


@cache
def _sound() -> tuple[Message, ...]:
    """Three seconds of a vehicle with eight motors."""
    made: list[Message] = [("B", bytes(40))]
    made += [("F", f"{name}:{fields}".encode()) for name, fields in _TOPICS.items()]
    made += [("I", _keyed("char[3] sys_name", b"PX4")), ("I", _keyed("uint32_t ver_sw_release", b"\xff\x00\x0f\x01"))]
    made += [("M", b"\0" + _keyed("char[4] perf", b"text"))]
    made += [("P", _keyed("int32_t SYS_AUTOSTART", struct.pack("<i", 60000)))]
    made += [("P", _keyed("float CA_ROTOR_COUNT", struct.pack("<f", 8.0)))]
    made += [("Q", b"\x01" + _keyed("float CA_ROTOR_COUNT", struct.pack("<f", 8.0)))]
    made += [("A", struct.pack("<BH", 0, number) + name.encode()) for number, name in enumerate(_TOPICS)]
    for k in range(60):
        bodies = (
            struct.pack("<12f", *np.sin(k / 5 + np.arange(8)), *[np.nan] * 4),
            struct.pack("<4f", np.cos(0.1), np.sin(0.1), 0.0, 0.0),
            struct.pack("<2B", 2 if k > 3 else 1, 0),
            struct.pack("<6f4B", k, 0, 1, 0, 0, 0, 1, 1, 1, 1),
            struct.pack("<6f", 0.0, 0.1, 0.2, 0.0, 0.0, -9.8),
            struct.pack("<2f", 15.0, 3.0),
        )
        stamp = struct.pack("<Q", 1_000_000 + k * 50_000)
        made += [("D", struct.pack("<H", number) + stamp + body) for number, body in enumerate(bodies)]
    made += [("L", b"6" + struct.pack("<Q", 2_000_000) + b"armed"), ("O", struct.pack("<H", 20))]
    return tuple(made)


def _field(draw: Draw) -> str:
    """A field of a topic: a type, perhaps so many of them, and a name."""
    size = f"[{draw(sizes | st.sampled_from((-1, 65535, '', 'x', 10**30)))}]" if chance(draw, 2) else ""
    return f"{draw(st.sampled_from(_TYPES) | texts)}{size} {draw(st.sampled_from(('timestamp', 'q', 'x')) | texts)}"


def _changed(draw: Draw, message: Message) -> Message:
    kind, body = message
    if kind == "F" and not chance(draw, 4):
        name, _, fields = body.decode("utf-8", "replace").partition(":")
        parts = fields.split(";")[:-1] or [""]
        if chance(draw, 2):
            parts[place(draw, len(parts))] = _field(draw)
        else:
            parts.insert(place(draw, len(parts)), _field(draw))
        return kind, f"{name}:{';'.join(parts)};".encode("utf-8", "surrogatepass")
    if kind in "IPMQ" and not chance(draw, 4):
        key = f"{draw(st.sampled_from(('char[9]', 'float', 'int32_t', 'uint8_t[4]', 'bool')) | texts)} " + draw(
            st.sampled_from(("sys_name", "ver_sw_release", "CA_ROTOR_COUNT", "SYS_AUTOSTART")) | texts
        )
        number = draw(integers.map(lambda n: (n % 2**32).to_bytes(4, "little")) | floats.map(_as_float) | raw)
        return kind, (b"\1" if kind in "MQ" else b"") + _keyed(key, number)
    if kind == "D" and not chance(draw, 4):
        new = draw(floats.map(_as_float) | raw | sizes.map(lambda n: n.to_bytes(8, "little")))
        at = draw(st.integers(0, max(len(body) - 4, 0)) | st.just(2))
        return kind, body[:at] + new + body[at + len(new) :]
    return draw(st.sampled_from((kind, *"BFIMPQADRSOLC\0?"))), draw(raw | st.binary(max_size=80))


def _as_float(value: float) -> bytes:
    return struct.pack("<f", value) if abs(value) < 3e38 else struct.pack("<f", float("inf"))


@st.composite
def _contents(draw: Draw) -> bytes:
    made = list(_sound())
    for _ in range(draw(st.integers(1, 2 * MOST)) if not chance(draw, 3) else 0):
        definitions = 20  # come first in the file and are few beside the data
        i = place(draw, definitions) if chance(draw, 2) else place(draw, len(made))
        new = _changed(draw, made[i])
        if new[0] == "D" and chance(draw, 4):
            same = made[i][1][:2]
            made = [("D", b[:10] + new[1][10:]) if k == "D" and b[:2] == same else (k, b) for k, b in made]
        else:
            made[i] = new
    messages = [struct.pack("<HB", len(body) % 65536, ord(kind)) + body for kind, body in reordered(draw, made)]
    if chance(draw, 8):
        messages.insert(place(draw, len(messages)), _SYNC)
    return bytes_altered(draw, _HEAD + b"".join(messages))


def logs() -> st.SearchStrategy[Log]:
    """Logs of PX4."""
    return named((".ulg", ".bin", ""), _contents())
