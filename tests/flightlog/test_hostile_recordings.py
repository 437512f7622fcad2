"""Recordings made to break a reader: what they claim, nest or become is bounded, and what is left out is named."""

import bz2
import json
import sqlite3
import struct

import numpy as np
import pytest

from auv_torchrl.flightlog import FlightLogError
from auv_torchrl.flightlog.readers import bounds, packings
from auv_torchrl.flightlog.readers.ardupilot import mavlink
from auv_torchrl.flightlog.readers.ros.ros_types import CDR, DefinitionError, Type
from auv_torchrl.flightlog.streams import tabulate
from tests.flightlog.test_other_recordings import mcap_file, ros_bag, ulog_file
from tests.flightlog.vehicle_log import streams_of

SAFE = {"STATUSTEXT", "PARAM_VALUE"}  # messages whose fields are texts
BEAT = {"mavtype": {"type": "MAV_TYPE_SUBMARINE"}, "autopilot": {"type": "MAV_AUTOPILOT_ARDUPILOTMEGA"},
        "base_mode": {"bits": 209}, "custom_mode": 19}  # fmt: skip
ODD = ("9" * 400, "-" + "9" * 400, "NaN", "Infinity", "1e999", '"text"', "[1]", "{}", "null", "true", "-1", "[" * 1000)
TWIST = b"\0\1\0\0" + struct.pack("<iII", 1, 0, 10) + b"base_link\0" + b"\0\0" + struct.pack("<6d", *range(6))


def text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


def record(kind: int, data: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(data)) + data


def channel(number: int, topic: str, encoding: str = "json", schema: int = 0) -> bytes:
    return record(4, struct.pack("<HH", number, schema) + text(topic) + text(encoding) + struct.pack("<I", 0))


def message(number: int, time_ns: int, data: bytes) -> bytes:
    return record(5, struct.pack("<HIQQ", number, 0, time_ns, time_ns) + data)


def chunk(packing: str, packed: bytes, size: int) -> bytes:
    return record(6, struct.pack("<QQQI", 0, 1, size, 0) + text(packing) + struct.pack("<Q", len(packed)) + packed)


def mcap(path, *records: bytes):
    """An MCAP file of these records."""
    end = record(15, bytes(4)) + record(2, bytes(20)) + b"\x89MCAP0\r\n"
    path.write_bytes(b"\x89MCAP0\r\n" + record(1, text("") + text("")) + b"".join(records) + end)
    return path


def beat(**changed) -> bytes:
    return json.dumps({"header": {}, "message": {"type": "HEARTBEAT", **BEAT, **changed}}).encode()


def said(path) -> str:
    """What is said of a recording, read or refused, in one line."""
    try:
        streams = streams_of(path)
    except FlightLogError as error:
        assert "\n" not in str(error) and path.name in str(error)
        return str(error)
    return " ".join(map(str, streams.findings))


@pytest.mark.parametrize("odd", ODD, ids=lambda odd: odd[:8])
def test_a_field_of_json_may_be_anything(tmp_path, odd):
    """In every field of every message: the message is left out and counted, or the value is none."""
    records, names = [], sorted(set(mavlink.WANTED) - SAFE)
    for number, name in enumerate(names, 1):
        records.append(channel(number, f"mavlink/1/1/{name}"))
        for field in mavlink.WANTED[name]:
            fields = ", ".join(f'"{other}": {odd if other == field else 1}' for other in mavlink.WANTED[name])
            fields = fields.replace('"type"', '"mavtype"')
            data = f'{{"message": {{"type": "{name}", {fields}}}}}'.encode()
            records.append(message(number, number * 10**7, data))
    records.append(message(names.index("HEARTBEAT") + 1, 10**9, beat()))
    path = mcap(tmp_path / "odd.mcap", *records)
    streams = streams_of(path)
    assert streams.armed and all(np.isfinite(s.t).all() for s in streams.streams.values())
    try:
        tabulate(streams)
    except FlightLogError as error:
        assert "\n" not in str(error)


def test_a_message_that_is_no_message_is_left_out(tmp_path):
    """Nested a thousand deep, cut, of another form; the sound one beside them is read."""
    odd = [b"[" * 60_000, b'{"a":' * 10_000, b"", b"\xff\xfe", b"7", b'{"message": 7}', b'{"message": {"type": []}}']
    records = [message(1, k, data) for k, data in enumerate([*odd, beat()])]
    path = mcap(tmp_path / "odd.mcap", channel(1, "mavlink/1/1/HEARTBEAT"), *records)
    assert "messages that cannot be read (6)" in said(path)
    assert streams_of(path).armed is not None


@pytest.mark.parametrize("packing", ["zstd", "lz4"])
def test_a_chunk_is_unpacked_piece_by_piece_up_to_a_bound(tmp_path, monkeypatch, packing):
    """What comes before the bound is read; what a message of gigabytes hides behind it is left out and named."""
    library = pytest.importorskip({"zstd": "zstandard", "lz4": "lz4.frame"}[packing])
    monkeypatch.setattr(packings, "MOST_CHUNK", 1 << 20)
    content = channel(1, "mavlink/1/1/HEARTBEAT") + message(1, 1, beat()) + message(1, 2, bytes(5 << 20))
    path = mcap(tmp_path / "bomb.mcap", chunk(packing, library.compress(content), len(content)))
    assert "chunks beyond their first 1 MiB (1)" in said(path)
    assert streams_of(path).armed is not None
    damaged = bytearray(library.compress(content))
    damaged[len(damaged) // 10 :] = bytes(len(damaged) - len(damaged) // 10)
    assert "damaged" in said(mcap(tmp_path / "damaged.mcap", chunk(packing, bytes(damaged), len(content))))


def test_all_chunks_together_have_a_bound(tmp_path, monkeypatch):
    """So that ten thousand small bombs are no large one."""
    monkeypatch.setattr(packings, "most_unpacked", lambda size: 3 << 20)
    content = channel(1, "mavlink/1/1/HEARTBEAT") + message(1, 1, beat()) + record(200, bytes(2 << 20))
    packed = pytest.importorskip("lz4.frame").compress(content)
    path = mcap(tmp_path / "bombs.mcap", *[chunk("lz4", packed, len(content))] * 4)
    assert "the rest of the file is not read: it unpacks to more than any recording does" in said(path)


def test_values_have_a_bound(tmp_path, monkeypatch):
    """A recording is read up to it, and a finding says that there is more."""
    monkeypatch.setattr(bounds, "MOST_VALUES", 2000)
    path = mcap_file(tmp_path / "long.mcap")
    assert "it holds more than 2,000 numbers" in said(path)
    assert 5 < len(streams_of(path).streams["attitude"]) < 100
    monkeypatch.setattr(bounds, "MOST_RECORDS", 100)
    assert "it holds more than 100 records" in said(path)


@pytest.mark.parametrize(
    "record",
    [
        struct.pack("<BQ", 6, 1 << 62),
        struct.pack("<BQ", 5, 1 << 62),
        record(6, struct.pack("<QQQI", 0, 1, 1 << 60, 0) + text("zstd") + struct.pack("<Q", 1 << 60)),
        record(6, struct.pack("<QQQI", 0, 1, 1, 0) + struct.pack("<I", 1 << 31)),
        record(4, struct.pack("<HHI", 1, 0, 1 << 31)),
        record(3, b""),
        record(5, b"x"),
        chunk("no such", b"", 0),
        record(0, b""),
    ],
)
def test_a_size_that_is_claimed_and_not_there_is_no_crash(tmp_path, record):
    """Of a chunk, a message, a text, a packing; what stood before is read."""
    path = mcap(tmp_path / "claims.mcap", channel(1, "mavlink/1/1/HEARTBEAT"), message(1, 1, beat()), record)
    assert "cut or damaged" in said(path)
    assert streams_of(path).armed is not None


def database(path, *messages, table="messages(topic_id, timestamp, data)", topics=()):
    """A bag in sqlite3 with these rows, of any type."""
    with sqlite3.connect(path) as made:
        made.execute("CREATE TABLE topics(id, name, type)")
        made.execute(f"CREATE {table if table.startswith('VIEW') else f'TABLE {table}'}")
        made.executemany(
            "INSERT INTO topics VALUES (?, ?, ?)", [(1, "/vel", "geometry_msgs/msg/TwistStamped"), *topics]
        )
        made.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", messages)
    made.close()
    return path


def test_columns_of_a_bag_may_hold_anything(tmp_path):
    """NULL, texts, fractions, blobs that are cut: those rows are left out and counted, the sound ones read."""
    odd = [(1, None, TWIST), (1, "now", TWIST), (1, 1.5, TWIST), (None, 1, TWIST), ("1", 1, TWIST), (1, 1, None),
           (1, 1, "x"), (1, 1, 7), (1, 1, b""), (1, 1, TWIST[:30]), (1, 1, b"\x28\xb5\x2f\xfd" + bytes(9))]  # fmt: skip
    sound = [(1, 10**9 + k * 10**8, TWIST) for k in range(5)]
    topics = [(None, None, None), (b"\xff", 3.5, "x")]
    path = database(tmp_path / "odd.db3", *odd, *sound, topics=topics)
    assert "topics that are damaged (2); messages that cannot be read (9)" in said(path)
    assert streams_of(path).streams["body_velocity"].values[0] == pytest.approx((0, -1, -2))


@pytest.mark.parametrize(
    "table",
    [
        "VIEW messages AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) "
        "SELECT 1 AS topic_id, i AS timestamp, zeroblob(1000000000) AS data FROM n",
        "messages(topic_id, timestamp, data GENERATED ALWAYS AS (zeroblob(900000000)) VIRTUAL)",
        "messages(topic_id, data)",
    ],
)
def test_a_database_that_makes_its_messages_up_is_refused(tmp_path, table):
    """A view, a column that is computed, one that is missing."""
    with sqlite3.connect(tmp_path / "bomb.db3") as made:
        made.execute("CREATE TABLE topics(id, name, type)")
        made.execute("INSERT INTO topics VALUES (1, '/vel', 'geometry_msgs/msg/TwistStamped')")
        made.execute(f"CREATE {table if table.startswith('VIEW') else f'TABLE {table}'}")
    made.close()
    assert "no table messages" in said(tmp_path / "bomb.db3")


def test_a_damaged_description_of_a_bag_changes_nothing(tmp_path):
    """metadata.yaml may be a bomb of aliases, cut, or no text: the messages are in the database."""
    folder = ros_bag(tmp_path / "flight", 2)
    plain = tabulate(streams_of(folder)).columns
    for content in (
        b"a: &a [x]\nb: &b [" + b"*a," * 1000 + b"]",
        b"\xff\xfe",
        b"",
        b"relative_file_paths:\n  - gone_1.db3\n",
    ):
        (folder / "metadata.yaml").write_bytes(content)
        assert tabulate(streams_of(folder)).columns["x"] == pytest.approx(plain["x"])
    assert "gone_1.db3, which metadata.yaml names and which is not there" in said(folder)


def test_a_pointer_in_the_folder_of_a_bag_is_named(tmp_path):
    """As for a single file: what it is a pointer of, and how to fetch the database."""
    folder = ros_bag(tmp_path / "flight", 2)
    (folder / "flight.db3").write_bytes(b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 23037476\n")
    assert "flight/flight.db3 is a pointer of git-lfs and not the log itself: fetch it with git lfs pull" in said(
        folder
    )


def bag_record(data: bytes, **fields: bytes) -> bytes:
    """A record of a bag of ROS 1."""
    head = b"".join(struct.pack("<I", len(k) + 1 + len(v)) + k.encode() + b"=" + v for k, v in fields.items())
    return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data


@pytest.mark.parametrize(
    "record",
    [
        bag_record(bz2.compress(bytes(3 << 20)), op=b"\5", compression=b"bz2", size=bytes(4)),
        bag_record(b"x", op=b"\5", compression=b"bz2", size=bytes(4)),
        bag_record(b"x", op=b"\5", compression=b"no such", size=bytes(4)),
        struct.pack("<I", 0xFFFFFFFF) + b"x" * 100,
        bag_record(b"", op=b"\5", compression=b"none")[:-4] + struct.pack("<I", 0xFFFFFFFF),
        bag_record(b"\xff\xff", op=b"\7", conn=bytes(4), topic=b"/x"),
        bag_record(b"x" * 70_000, op=b"\2", conn=bytes(4), time=bytes(3)),
    ],
)
def test_a_damaged_bag_is_one_line(tmp_path, record):
    """Chunks, headers and sizes that are not what they say."""
    path = tmp_path / "flight.bag"
    path.write_bytes(b"#ROSBAG V2.0\n" + bag_record(b"", op=b"\3") + record)
    assert "flight.bag" in said(path)


def test_a_bag_without_its_index_is_read_as_far_as_it_goes(tmp_path):
    """As a recorder leaves it that was killed: most of the messages, and a finding."""
    whole = ros_bag(tmp_path / "flight.bag", 1).read_bytes()
    path = tmp_path / "cut.bag"
    path.write_bytes(whole[: len(whole) // 2])
    assert "cut or damaged" in said(path)
    assert 20 < len(streams_of(path).streams["position"]) < 100


@pytest.mark.parametrize(
    "definition",
    [
        "A[] x\n" + "=" * 80 + "\nMSG: p/A\nuint8[0] y",  # 4 bytes of it claim 4,000,000,000 of them
        "T x",  # holds itself
        "\n".join(f"A x{k}" for k in range(400)) + "\n" + "=" * 80 + "\nMSG: p/A\nint8 a\nint8 b\nint8 c",
        "Nowhere x", "int8", "int8 x y z = = \n[", "\xff",
    ],
)  # fmt: skip
def test_a_type_that_cannot_be_read_is_refused_before_its_messages(definition):
    """Without content, without end, too large, not defined, no definition."""
    with pytest.raises(DefinitionError):
        Type("p/T", definition, CDR)


def test_a_length_in_a_message_is_held_against_its_bytes():
    """Of texts, of arrays of numbers and of messages."""
    kind = Type("p/T", "string a\nfloat64[] b\nT2[] c\n" + "=" * 80 + "\nMSG: p/T2\nuint8 d", CDR)
    assert kind.values(b"\0\1\0\0" + bytes(12))["b"] == ()
    for at in (0, 4, 8):
        data = bytearray(b"\0\1\0\0" + bytes(12))
        data[4 + at : 8 + at] = b"\xff\xff\xff\xff"
        with pytest.raises((struct.error, ValueError)):
            kind.values(bytes(data))


@pytest.mark.parametrize(
    "described",
    [
        b"vehicle_attitude:uint64_t timestamp;float[4000000000] q;",
        b"vehicle_attitude:uint64_t timestamp;float[60000] q;",
        b"vehicle_attitude:vehicle_attitude x;",
        b"vehicle_attitude:float q;float q;",
        b"vehicle_attitude:nothing q;",
        b"vehicle_attitude:uint64_t timestamp;float[-4] q;",
        b"vehicle_attitude",
    ],
)
def test_a_topic_of_px4_is_no_larger_than_a_message(tmp_path, described):
    """Arrays of gigabytes, types in themselves: that topic is left out, the others are read."""
    whole, old = ulog_file(), b"vehicle_attitude:uint64_t timestamp;float[4] q;"
    head = struct.pack("<HB", len(old), ord("F")) + old
    assert head in whole
    path = tmp_path / "flight.ulg"
    path.write_bytes(whole.replace(head, struct.pack("<HB", len(described), ord("F")) + described))
    assert "damaged" in said(path)
    assert "commands" in streams_of(path).streams and "attitude" not in streams_of(path).streams


def test_a_px4_log_goes_on_behind_damage(tmp_path):
    """Bytes in the middle that are none: the messages behind them are read."""
    whole = ulog_file()
    path = tmp_path / "flight.ulg"
    path.write_bytes(whole[:8000] + bytes(500) + whole[8000:])
    assert "damaged bytes" in said(path)
    assert len(streams_of(path).streams["attitude"]) > 150
