"""ROS bags: ROS 1 byte by byte, ROS 2 as folders of sqlite3 or MCAP, with messages, definitions and tables altered."""

import bz2
import contextlib
import sqlite3
import struct
import tempfile
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import strategies as st

from tests.flightlog.fuzz import mcap
from tests.flightlog.fuzz.damage import MOST, Draw, Log, bytes_altered, chance, named, place, reordered
from tests.flightlog.fuzz.values import floats, numbers, raw, sizes, texts

_TYPES = (
    "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu", "std_msgs/msg/Float64MultiArray", "sensor_msgs/msg/BatteryState",
)  # fmt: skip
_DEFINITIONS = (  # that are no definition, or one that claims much
    "", "float64", "float64[4000000000] x", "float64[99999999999999999999] x", "Empty[4000000000] x\n" + "=" * 80 +
    "\nMSG: a/Empty\n", "a/A x\n" + "=" * 80 + "\nMSG: a/A\na/A x", "float64 x\nfloat64 x", "string X=" + "y" * 9999,
    "nothing/Nothing x", "int32 x=" + "9" * 400, "float64 \x1b[31mx", "# " + "x" * 9999, "float64[" * 1000, "header h",
    "float64 " + "x" * 5000, "float64 class", "float64 __init__", "uint8[] data", "string[] data", "float64 1x",
    "std_msgs/Header header\nstring data", "bool[<=5] x", "wstring data",
)  # fmt: skip
_KINDS = (
    *_TYPES, "mavros_msgs/msg/RCOut", "mavros_msgs/msg/State", "geometry_msgs/msg/PoseStamped", "std_msgs/msg/String",
    "std_msgs/msg/Float32MultiArray", "", "a", "a/b/c/d", "\x1b[31m/msg/X", "std_msgs/Float64MultiArray",
)  # fmt: skip


class Connection(NamedTuple):
    """A topic: its name, the type of its messages, and how the bag describes the type."""

    topic: str
    kind: str
    definition: str
    digest: str


class Sent(NamedTuple):
    """A message: number of the connection, time in ns and content."""

    connection: int
    stamp: int
    data: bytes


@cache
def _store(version: int) -> Any:
    typesys = pytest.importorskip("rosbags.typesys")
    return typesys.get_typestore(typesys.Stores.ROS1_NOETIC if version == 1 else typesys.Stores.ROS2_HUMBLE)


def _messages(k: int, version: int) -> list[tuple[Any, str]]:
    kinds = _store(version).types
    vector, turn = kinds["geometry_msgs/msg/Vector3"], kinds["geometry_msgs/msg/Quaternion"]
    stamp = kinds["builtin_interfaces/msg/Time"](sec=1_700_000_000 + k // 20, nanosec=k % 20 * 50_000_000)
    header = kinds["std_msgs/msg/Header"](stamp=stamp, frame_id="odom", **({"seq": k} if version == 1 else {}))
    pose = kinds["geometry_msgs/msg/Pose"](
        position=kinds["geometry_msgs/msg/Point"](x=1.0, y=k / 20, z=-3.0 + 0.1 * np.sin(k / 9)),
        orientation=turn(x=0.0, y=0.0, z=np.sin(k / 80), w=np.cos(k / 80)),
    )
    twist = kinds["geometry_msgs/msg/Twist"](linear=vector(x=1.0, y=0.1, z=0.2), angular=vector(x=0.0, y=0.0, z=0.3))
    odometry = kinds[_TYPES[0]](
        header=header,
        child_frame_id="base_link",
        pose=kinds["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=np.zeros(36)),
        twist=kinds["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=np.zeros(36)),
    )
    imu = kinds[_TYPES[1]](
        header=header,
        orientation=turn(x=0.0, y=0.0, z=0.0, w=1.0),
        orientation_covariance=np.array([-1.0] + [0.0] * 8),
        angular_velocity=vector(x=0.0, y=0.2, z=0.3),
        angular_velocity_covariance=np.zeros(9),
        linear_acceleration=vector(x=0.0, y=0.0, z=9.81),
        linear_acceleration_covariance=np.zeros(9),
    )
    layout = kinds["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    sent = kinds[_TYPES[2]](layout=layout, data=np.sin(k / 5 + np.arange(8)))
    battery = kinds[_TYPES[3]](
        header=header, voltage=15.0, temperature=20.0, current=-3.0, charge=1.0, capacity=1.0, design_capacity=1.0,
        percentage=1.0, power_supply_status=0, power_supply_health=0, power_supply_technology=0, present=True,
        cell_voltage=np.zeros(0, np.float32), cell_temperature=np.zeros(0, np.float32), location="x", serial_number="y",
    )  # fmt: skip
    return list(zip((odometry, imu, sent, battery), _TYPES, strict=True))


@cache
def _sound(version: int) -> tuple[tuple[Connection, ...], tuple[Sent, ...]]:
    """Two seconds of a vehicle with eight thrusters."""
    store = _store(version)
    connections = []
    for kind, topic in zip(_TYPES, ("/odom", "/imu", "/thrusters", "/battery"), strict=True):
        connections.append(Connection(topic, kind, *store.generate_msgdef(kind, ros_version=version)))
    put = store.serialize_ros1 if version == 1 else store.serialize_cdr
    sent = [
        Sent(number, round((1.7e9 + k / 20) * 1e9), bytes(put(made, kind)))
        for k in range(40)
        for number, (made, kind) in enumerate(_messages(k, version))
    ]
    return tuple(connections), tuple(sent)


@st.composite
def _parts(draw: Draw, version: int) -> tuple[list[Connection], list[Sent]]:
    """Connections and messages, some of them altered."""
    connections, sent = list(_sound(version)[0]), list(_sound(version)[1])
    for _ in range(draw(st.integers(1, 2)) if chance(draw, 3) else 0):
        i = place(draw, len(connections))
        match draw(st.sampled_from(("definition", "definition", "kind", "topic", "digest"))):
            case "definition":
                definition = draw(st.sampled_from(_DEFINITIONS) | texts)
                if chance(draw, 2):  # more than the messages hold
                    definition = connections[i].definition.replace("float64", definition, 1)
                connections[i] = connections[i]._replace(definition=definition)
            case "kind":
                connections[i] = connections[i]._replace(kind=draw(st.sampled_from(_KINDS) | texts))
            case "topic":
                connections[i] = connections[i]._replace(topic=draw(texts))
            case "digest":
                connections[i] = connections[i]._replace(digest=draw(texts))
    for _ in range(draw(st.integers(1, 2 * MOST)) if chance(draw, 2) else 0):
        i = place(draw, len(sent))
        _, stamp, data = sent[i]
        match draw(st.sampled_from(("float", "float", "length", "any", "short", "long", "stamp"))):
            case "float":
                at = place(draw, len(data) // 4) * 4
                new = struct.pack("<d", draw(floats))
                data = data[:at] + new + data[at + 8 :]
            case "length":
                at = place(draw, min(len(data), 60) // 4) * 4
                data = data[:at] + struct.pack("<I", draw(sizes) % 2**32) + data[at + 4 :]
            case "any":
                data = draw(raw)
            case "short":
                data = data[: place(draw, len(data))]
            case "long":
                data += draw(raw)
            case "stamp":
                stamp = draw(sizes | st.integers(stamp - 10**10, stamp + 10**10))
        sent[i] = sent[i]._replace(data=data, stamp=stamp)
    return connections, reordered(draw, sent)


# ROS 1: http://wiki.ros.org/Bags/Format/2.0


def _pairs(fields: dict[str, bytes]) -> bytes:
    return b"".join(_number(len(key) + 1 + len(value)) + key.encode() + b"=" + value for key, value in fields.items())


def _record(fields: dict[str, bytes], data: bytes) -> bytes:
    head = b"".join(
        struct.pack("<I", len(key) + 1 + len(value)) + key.encode() + b"=" + value for key, value in fields.items()
    )
    return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data


def _number(value: int, size: int = 4) -> bytes:
    return (value % 256**size).to_bytes(size, "little")


def _time(stamp: int) -> bytes:
    return _number(stamp // 10**9) + _number(stamp % 10**9)


def _any_field(draw: Draw, fields: dict[str, bytes]) -> dict[str, bytes]:
    """The fields of a record, in few logs one of them of any bytes or lost."""
    if not chance(draw, 100):
        return fields
    key = draw(st.sampled_from(list(fields)))
    value = draw(raw | sizes.map(lambda n: _number(n, 8)) | sizes.map(_number) | st.none())
    return {k: v for k, v in fields.items() if k != key} | ({key: value} if value is not None else {})


def _connection_record(draw: Draw, number: int, connection: Connection) -> bytes:
    said = {
        "topic": connection.topic.encode("utf-8", "surrogatepass"),
        "type": connection.kind.replace("/msg/", "/").encode("utf-8", "surrogatepass"),
        "md5sum": connection.digest.encode("utf-8", "surrogatepass"),
        "message_definition": connection.definition.encode("utf-8", "surrogatepass"),
    }
    data = b"".join(
        struct.pack("<I", len(k) + 1 + len(v)) + k.encode() + b"=" + v for k, v in _any_field(draw, said).items()
    )
    fields = {"op": b"\7", "conn": _number(number), "topic": said["topic"]}
    return _record(_any_field(draw, fields), data)


@st.composite
def _ros1(draw: Draw) -> bytes:
    connections, sent = draw(_parts(1))
    described = [_connection_record(draw, i, connection) for i, connection in enumerate(connections)]
    data, offsets = b"".join(described), {i: b"" for i in range(len(connections))}
    counts = dict.fromkeys(offsets, 0)
    for number, stamp, content in sent:
        offsets[number] += _time(stamp) + _number(len(data))
        counts[number] += 1
        data += _record({"op": b"\2", "conn": _number(number), "time": _time(stamp)}, content)
    compression = draw(st.sampled_from((b"none", b"none", b"lz4", b"bz2", b"zip", b"\xff")))
    packed = data
    if compression == b"lz4":
        packed = mcap.bomb("lz4") if chance(draw, 4) else pytest.importorskip("lz4.frame").compress(data)
    elif compression == b"bz2":
        packed = _bz2_bomb() if chance(draw, 4) else bz2.compress(data, 1)
    size = draw(sizes) if chance(draw, 8) else len(data)
    chunk = _record(_any_field(draw, {"op": b"\5", "compression": compression, "size": _number(size)}), packed)
    for number, entries in offsets.items():
        fields = {"op": b"\4", "ver": _number(1), "conn": _number(number), "count": _number(counts[number])}
        chunk += _record(_any_field(draw, fields), entries)
    head_size = 4096 + 13
    times = [stamp for _, stamp, _ in sent] or [0]
    info = {
        "op": b"\6", "ver": _number(1), "chunk_pos": _number(head_size, 8), "start_time": _time(min(times)),
        "end_time": _time(max(times)), "count": _number(len(connections)),
    }  # fmt: skip
    counted = b"".join(_number(i) + _number(count) for i, count in counts.items())
    index = b"".join(described) + _record(_any_field(draw, info), counted)
    fields = {
        "op": b"\3", "index_pos": _number(head_size + len(chunk), 8), "conn_count": _number(len(connections)),
        "chunk_count": _number(1),
    }  # fmt: skip
    head = _record(_any_field(draw, fields), b"")
    head = head[:-4] + struct.pack("<I", 4096 - len(head)) + b" " * (4096 - len(head))
    return bytes_altered(draw, b"#ROSBAG V2.0\n" + head + chunk + index)


@cache
def _bz2_bomb() -> bytes:
    packer = bz2.BZ2Compressor(9)
    return b"".join((*(packer.compress(bytes(1 << 24)) for _ in range(8)), packer.flush()))  # 128 MB: slow to make


def ros1_logs() -> st.SearchStrategy[Log]:
    """Bags of ROS 1."""
    return named((".bag", ".bag", ".bag", ""), _ros1())


@cache
def sound_bag(storage: str) -> dict[str, bytes]:
    """The files of a bag that the library wrote."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    plugin = rosbag2.StoragePlugin.MCAP if storage == "mcap" else rosbag2.StoragePlugin.SQLITE3
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "flight"
        connections, sent = _sound(2)
        with rosbag2.Writer(path, version=9, storage_plugin=plugin) as out:
            added = [out.add_connection(c.topic, c.kind, typestore=_store(2)) for c in connections]
            for number, stamp, data in sent:
                out.write(added[number], stamp, data)
        return {file.name: file.read_bytes() for file in path.iterdir()}


_COLUMNS = {
    "schema": ("schema_version", "ros_distro"), "metadata": ("metadata_version", "metadata"),
    "topics": ("name", "type", "serialization_format", "offered_qos_profiles", "type_description_hash"),
    "message_definitions": ("topic_type", "encoding", "encoded_message_definition", "type_description_hash"),
    "messages": ("topic_id", "timestamp", "data"),
}  # fmt: skip


@st.composite
def _database(draw: Draw) -> bytes:
    """A database whose rows hold any type: sqlite asks for none."""
    connections, sent = draw(_parts(2))
    base = sqlite3.connect(":memory:")
    base.deserialize(sound_bag("sqlite3")["flight.db3"])
    with base:
        base.execute("DELETE FROM messages")
        rows = [(m.connection + 1, m.stamp if m.stamp < 2**63 else -1, m.data) for m in sent]
        base.executemany("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)", rows)
        for number, now in enumerate(connections, 1):
            topic, kind, definition = (part.encode("utf-8", "replace").decode() for part in now[:3])
            if now != _sound(2)[0][number - 1]:
                base.execute("UPDATE topics SET name=?, type=? WHERE id=?", (topic, kind, number))
                base.execute(
                    "UPDATE message_definitions SET topic_type=?, encoded_message_definition=? WHERE id=?",
                    (kind, definition, number),
                )
        for _ in range(draw(st.integers(1, MOST)) if chance(draw, 2) else 0):
            _change_database(draw, base)
    return bytes_altered(draw, base.serialize())


def _change_database(draw: Draw, base: sqlite3.Connection) -> None:
    table = draw(st.sampled_from([*_COLUMNS, "messages"]))
    if not list(base.execute(f"PRAGMA table_info({table})")):  # was dropped before
        return
    match draw(st.sampled_from(("value", "value", "value", "all", "rows", "drop", "column"))):
        case "rows":
            base.execute(f"DELETE FROM {table}")
        case "drop":
            base.execute(f"DROP TABLE {table}")
        case "column":
            column = draw(st.sampled_from(_COLUMNS[table]))
            if _has(base, table, column):
                base.execute(f"ALTER TABLE {table} RENAME COLUMN {column} TO {column}_")
        case where:
            column = draw(st.sampled_from(_COLUMNS[table]))
            value = draw(st.one_of(texts, raw, numbers, st.sampled_from(_DEFINITIONS), st.just("ros2idl")))
            if isinstance(value, int) and abs(value) >= 2**63:
                value = str(value)[:4000]
            if isinstance(value, str):
                value = value.encode("utf-8", "replace").decode()
            if isinstance(value, float) and value != value:
                value = -1.0  # NaN is NULL, which these columns refuse
            if _has(base, table, column):
                first = "" if where == "all" else f" WHERE rowid IN (SELECT rowid FROM {table} LIMIT 1)"
                with contextlib.suppress(sqlite3.IntegrityError):  # the keys of a table alone have to be of their type
                    base.execute(f"UPDATE OR IGNORE {table} SET {column}=?{first}", (value,))


def _has(base: sqlite3.Connection, table: str, column: str) -> bool:
    return column in {row[1] for row in base.execute(f"PRAGMA table_info({table})")}


_YAML = (
    "[" * 1000, "&a [*a]", "!!python/object/apply:os.system [id]", "9" * 400, ".nan", "~", "[]", "{}", "'x'", "-1",
    "2001-01-01", "\x1b[31m", "[../flight.db3]", "[/dev/zero]", "[flight.db3, flight.db3]", "[gone.db3]", "*b", "\xff",
    "!!set {a}", "1e999", "&a [x,x,x,x,x,x,x]\n  b: &b [*a,*a,*a,*a,*a,*a,*a]\n  c: &c [*b,*b,*b,*b,*b]\n  d: [*c,*c]",
    "zstd", "file", "message", "mcap", "sqlite3",
)  # fmt: skip


@st.composite
def _description(draw: Draw, said: bytes) -> bytes:
    """metadata.yaml with values of its lines replaced or lines lost."""
    lines = said.decode().splitlines()
    for _ in range(draw(st.integers(1, MOST)) if chance(draw, 3) else 0):
        i = place(draw, len(lines))
        key, colon, _ = lines[i].partition(":")
        if colon and not chance(draw, 4):
            lines[i] = f"{key}: {draw(st.sampled_from(_YAML) | texts)}"
        else:
            del lines[i]
        if not lines:
            break
    return bytes_altered(draw, "\n".join(lines).encode("utf-8", "surrogatepass"))


@st.composite
def _mcap(draw: Draw) -> bytes:
    """A recording of ROS 2, by hand and without an index, or as the library wrote it with bytes altered."""
    if chance(draw, 3):
        return bytes_altered(draw, sound_bag("mcap")["flight.mcap"])
    connections, sent = draw(_parts(2))
    records: list[mcap.Record] = []
    for number, c in enumerate(connections):
        schema = struct.pack("<H", number + 1) + mcap.text(c.kind) + mcap.text("ros2msg") + mcap.text(c.definition)
        records += [(mcap.SCHEMA, schema), mcap.channel(number, number + 1, c.topic, "cdr")]
    records += [mcap.message(m.connection, m.stamp * 1e-9 - 1.7e9 if m.stamp < 2**62 else 0.0, m.data) for m in sent]
    whole = draw(mcap.in_chunks(mcap.altered_records(draw, records)))
    return bytes_altered(draw, mcap.file_of(whole, draw(st.sampled_from(("ros2", "ros2", "ros2", "ros1", "")))))


_POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 12345\n"


@st.composite
def _ros2(draw: Draw, storage: str) -> bytes | dict[str, bytes]:
    """A folder, or its recording alone."""
    recording = draw(_database() if storage == "sqlite3" else _mcap())
    if chance(draw, 3):
        return recording
    if chance(draw, 20):
        recording = draw(st.sampled_from((_POINTER, b"", b"\0" * 100)))
    name = "flight.db3" if storage == "sqlite3" else "flight.mcap"
    described = draw(_description(sound_bag(storage)["metadata.yaml"]))
    folder = {name: recording, "metadata.yaml": described}
    if chance(draw, 20):
        del folder[draw(st.sampled_from(sorted(folder)))]
    return folder


def sqlite_logs() -> st.SearchStrategy[Log]:
    """Bags of ROS 2 in sqlite3."""
    return named((".db3", ".db3", ".db3", ""), _ros2("sqlite3"))


def ros2_mcap_logs() -> st.SearchStrategy[Log]:
    """Bags of ROS 2 in MCAP."""
    return named((".mcap", ".mcap", ".mcap", ""), _ros2("mcap"))
