"""MCAP: MAVLink as JSON of any fields that JSON can say, and records and chunks that claim what is not so."""

import bz2
import json
import math
import struct
import zlib
from collections.abc import Sequence
from functools import cache
from typing import Any

import pytest
from hypothesis import strategies as st

from tests.flightlog.dataflash_writer import ALL
from tests.flightlog.fuzz.damage import MOST, Draw, Log, bytes_altered, chance, named, place, reordered
from tests.flightlog.fuzz.values import json_texts, raw, sizes, texts

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, DATA_END = 1, 2, 3, 4, 5, 6, 15
_HELD = "@@{}@@"  # stands for a field in the text of a message
BOMB_BYTES = 2 << 30  # that a few kB unpack to; twice of what may be held

Record = tuple[int, bytes]  # kind and body


def text(value: str | bytes) -> bytes:
    """A text behind its length."""
    data = value if isinstance(value, bytes) else value.encode("utf-8", "surrogatepass")
    return struct.pack("<I", len(data)) + data


def written(records: Sequence[Record]) -> bytes:
    """Records behind each other, each with kind and length."""
    return b"".join(struct.pack("<BQ", kind, len(body)) + body for kind, body in records)


def channel(number: int, schema: int, topic: str | bytes, encoding: str | bytes) -> Record:
    """A channel without metadata."""
    return CHANNEL, struct.pack("<HH", number, schema) + text(topic) + text(encoding) + text(b"")


def message(number: int, t: float, data: bytes) -> Record:
    """A message of a channel at ``t`` s."""
    stamp = round((1.7e9 + t) * 1e9)
    return MESSAGE, struct.pack("<HIQQ", number, 0, stamp, stamp) + data


def _fields(t: float, k: int) -> list[tuple[str, dict[str, Any]]]:
    since = {"time_boot_ms": round((t + 50) * 1e3)}
    sent: list[tuple[str, dict[str, Any]]] = []
    if k % 10 == 0:
        beat = {"mavtype": {"type": "MAV_TYPE_SUBMARINE"}, "autopilot": {"type": "MAV_AUTOPILOT_ARDUPILOTMEGA"}}
        sent.append(("HEARTBEAT", {"base_mode": {"bits": 209 if k else 81}, "custom_mode": 19, **beat}))
        sent.append(("EKF_STATUS_REPORT", {"flags": "EKF_ATTITUDE | EKF_POS_HORIZ_REL | EKF_VELOCITY_HORIZ"}))
        sent.append(("SYS_STATUS", {"voltage_battery": 15000, "current_battery": 300}))
    servos = {f"servo{n}_raw": 1500 + 20 * ((k + n) % 7) for n in range(1, 17)}
    sent.append(("SERVO_OUTPUT_RAW", {"time_usec": round((t + 50) * 1e6), "port": 0, **servos}))
    rates = {"rollspeed": 0.0, "pitchspeed": 0.0, "yawspeed": 0.5}
    sent.append(("ATTITUDE", {**since, "roll": 0.1, "pitch": 0.01 * math.sin(t), "yaw": 0.5 * t, **rates}))
    sent.append(
        (
            "LOCAL_POSITION_NED",
            {**since, "x": 0.2 * t, "y": 2.0 + t, "z": 3.0 + 0.1 * math.sin(t), "vx": 0.2, "vy": 1.0, "vz": 0.0},
        )
    )
    sent.append(("RAW_IMU", {"time_usec": round((t + 50) * 1e6), "xacc": 0, "yacc": 0, "zacc": -1000}))
    return sent


@cache
def _sound() -> tuple[tuple[float, str, dict[str, Any]], ...]:
    """Times, names and fields of three seconds of a Heavy."""
    made: list[tuple[float, str, dict[str, Any]]] = [
        (0.0, "STATUSTEXT", {"text": [*"ArduSub V4.5.0", "\0", "x"], "severity": {"type": "MAV_SEVERITY_INFO"}})
    ]
    for name, value in ALL.items():
        made.append((0.0, "PARAM_VALUE", {"param_id": [*name, "\0"], "param_value": float(value), "param_count": 1}))
    for k in range(30):
        made += [(k / 10, name, fields) for name, fields in _fields(k / 10, k)]
    return tuple(made)


@st.composite
def _texts(draw: Draw) -> list[tuple[float, str, bytes]]:
    """Times, topics and JSON, some fields of which are anything."""
    sound = list(_sound())
    common = chance(draw, 8)  # everything under one topic
    found: list[tuple[float, str, bytes]] = []
    hit = {place(draw, len(sound)) for _ in range(draw(st.integers(1, 2 * MOST)))} if not chance(draw, 3) else set()
    for i, (t, name, fields) in enumerate(sound):
        topic = "mavlink/out" if common else f"mavlink/1/1/{name}"
        body: Any = {"header": {"system_id": 1, "component_id": 1}, "message": {"type": name, **fields}}
        if i not in hit:
            found.append((t, topic, json.dumps(body).encode()))
            continue
        match draw(st.sampled_from(("field", "field", "field", "lost", "name", "header", "body", "part", "topic"))):
            case "field":
                body["message"][draw(st.sampled_from(list(fields)))] = _HELD
            case "lost":
                del body["message"][draw(st.sampled_from(list(fields)))]
            case "name":
                body["message"]["type"] = _HELD
            case "header":
                body["header"][draw(st.sampled_from(("system_id", "component_id")))] = _HELD
            case "part":
                body[draw(st.sampled_from(("header", "message")))] = _HELD
            case "body":
                body = _HELD
            case "topic":
                topic = draw(st.sampled_from((f"mavlink/{'9' * 400}/1/{name}", f"mavlink/２/1/{name}")) | texts)
        spelt = json.dumps(body).encode().replace(b'"@@{}@@"', draw(json_texts).encode("utf-8", "surrogatepass"))
        found.append((t, topic, bytes_altered(draw, spelt) if chance(draw, 4) else spelt))
    return found


def recorded(texts_: Sequence[tuple[float, str, bytes]]) -> list[Record]:
    """The records of JSON messages: each channel before its first message."""
    records: list[Record] = [(SCHEMA, struct.pack("<H", 1) + text("any") + text("jsonschema") + text("{}"))]
    numbers: dict[str, int] = {}
    for t, topic, data in texts_:
        if topic not in numbers:
            numbers[topic] = len(numbers)
            records.append(channel(numbers[topic], 1, topic, "json"))
        records.append(message(numbers[topic], t, data))
    return records


def chunk(records: bytes, compression: str | bytes = "", claimed: int | None = None, crc: int = 0) -> Record:
    """Records in a chunk, compressed, of a size that is claimed."""
    packed = records
    if compression == "zstd":
        packed = pytest.importorskip("zstandard").compress(records)
    elif compression == "lz4":
        packed = pytest.importorskip("lz4.frame").compress(records)
    elif compression == "bz2":
        packed = bz2.compress(records)
    size = len(records) if claimed is None else claimed
    return CHUNK, _chunk_head(size, compression, len(packed), crc) + packed


def _chunk_head(size: int, compression: str | bytes, packed: int, crc: int = 0) -> bytes:
    return struct.pack("<QQQI", 0, 2**62, size, crc) + text(compression) + struct.pack("<Q", packed)


@cache
def bomb(compression: str) -> bytes:
    """A few kB of zeros that unpack to :data:`BOMB_BYTES`."""
    block = bytes(1 << 24)
    if compression == "zstd":
        packer: Any = pytest.importorskip("zstandard").ZstdCompressor().compressobj()
        pieces = [packer.compress(block) for _ in range(BOMB_BYTES >> 24)]
    else:
        packer = pytest.importorskip("lz4.frame").LZ4FrameCompressor(block_size=7)
        pieces = [packer.begin(), *(packer.compress(block) for _ in range(BOMB_BYTES >> 24))]
    return b"".join((*pieces, packer.flush()))


def file_of(records: Sequence[Record], profile: str = "") -> bytes:
    """An MCAP file without an index."""
    end: list[Record] = [(DATA_END, struct.pack("<I", 0)), (FOOTER, struct.pack("<QQI", 0, 0, 0))]
    return MAGIC + written([(HEADER, text(profile) + text("fuzz")), *records, *end]) + MAGIC


def altered_records(draw: Draw, records: list[Record]) -> list[Record]:
    """Records with other bodies, kinds and order."""
    for _ in range(draw(st.integers(1, MOST)) if chance(draw, 4) else 0):
        i = place(draw, len(records))
        kind, body = records[i]
        at = place(draw, min(len(body), 40))  # where the numbers and lengths are
        new = draw(
            raw | sizes.map(lambda n: n.to_bytes(8, "little")) | sizes.map(lambda n: (n % 2**32).to_bytes(4, "little"))
        )
        records[i] = (draw(st.sampled_from((kind, kind, *range(20)))), body[:at] + new + body[at + len(new) :])
    return reordered(draw, records)


@st.composite
def in_chunks(draw: Draw, records: list[Record]) -> list[Record]:
    """Records as they are, or in a chunk whose size, sum or content may be another one."""
    match draw(st.sampled_from(("plain", "plain", "chunk", "chunk", "claim", "bomb", "nested"))):
        case "plain":
            return records
        case "chunk":
            half = place(draw, len(records))
            data = written(records[half:])
            return [*records[:half], chunk(data, draw(st.sampled_from(("", "zstd", "lz4"))), crc=zlib.crc32(data))]
        case "claim":
            compression = draw(st.sampled_from(("", "zstd", "lz4", "bz2")) | raw)
            data = bytes_altered(draw, written(records))
            return [chunk(data, compression, draw(sizes), draw(st.sampled_from((0, 1))))]
        case "nested":
            return [chunk(written([chunk(written(records), "zstd")]), "zstd")]
    compression = draw(st.sampled_from(("zstd", "lz4")))
    packed = bomb(compression)
    claimed = draw(st.sampled_from((BOMB_BYTES, 1000, 0, 2**40)))
    body = _chunk_head(claimed, compression, len(packed)) + packed
    records.insert(place(draw, len(records)), (CHUNK, body))
    return records


@st.composite
def _contents(draw: Draw) -> bytes:
    records = altered_records(draw, recorded(reordered(draw, draw(_texts()))))
    return bytes_altered(draw, file_of(draw(in_chunks(records))))


def logs() -> st.SearchStrategy[Log]:
    """MCAP recordings of MAVLink."""
    return named((".mcap", ".bin", ""), _contents())
