"""Bags of ROS 1, and of ROS 2 in sqlite3, as messages one by one.

http://wiki.ros.org/Bags/Format/2.0 describes the first; they are read from the front, so that one whose recorder was
killed, without an index at its end, is read as well. A bag of ROS 2 is a database or an MCAP file, or several in a
folder.
"""

import io
import os
import re
import sqlite3
import struct
from pathlib import Path, PurePosixPath
from typing import IO
from urllib.parse import quote

from auv_torchrl.flightlog.readers.bounds import MIB, MOST_MESSAGE, MOST_NAME, Loss, Part, skip
from auv_torchrl.flightlog.readers.packed_log import BAG, STORAGE
from auv_torchrl.flightlog.readers.packings import DAMAGED, Chunks
from auv_torchrl.flightlog.readers.recording import Channel, Messages, Wanted, short
from auv_torchrl.flightlog.readers.ros.ros_types import CDR, ROS1
from auv_torchrl.text import in_order

SQLITE, BAG_1 = b"SQLite format 3\0", b"#ROSBAG V2"
_MESSAGE, _CHUNK, _CONNECTION = b"\2", b"\5", b"\7"  # kinds of records
_CHUNK_PACKINGS = {b"none": "", b"bz2": "bzip2", b"lz4": "lz4"}
_MOST_HEADER = MIB  # bytes of the fields of a record; they are some names and numbers
_MOST_CONNECTIONS = 10_000  # topics of a bag; large systems have some hundreds
_MOST_DEFINITIONS = 16 * MIB  # bytes of all definitions of types; ROS has some kB of each
_STEPS, _MOST_STEPS = 1_000_000, 2_000  # of sqlite's machine between two looks, and looks: a minute; 10 GB need 100
_COLUMNS = {"topics": ("id", "name", "type"), "messages": ("topic_id", "timestamp", "data")}
_NAMED = re.compile(
    r"^[ \t]*-[ \t]+['\"]?([^\s'\"]{1,255}\.(?:db3|mcap))['\"]?[ \t\r]*$", re.MULTILINE
)  # of metadata.yaml
_DEFINED = ("topic_type", "encoding", "encoded_message_definition")


class _Connections:
    """Topics of a bag of ROS 1 by number."""

    def __init__(self, wanted: Wanted, seen: dict[Channel, None]) -> None:
        self.wanted: dict[bytes, Channel] = {}
        self._is_wanted, self._seen = wanted, seen
        self._room = _MOST_DEFINITIONS

    def add(self, number: bytes, topic: bytes, fields: dict[bytes, bytes]) -> None:
        """Take a connection; it may come again."""
        kind, definition = (fields.get(key, b"").decode("utf-8", "replace") for key in (b"type", b"message_definition"))
        channel = Channel(topic.decode("utf-8", "replace")[:MOST_NAME], short(kind), ROS1, definition)
        plain = channel._replace(definition="")
        if plain not in self._seen and len(self._seen) >= _MOST_CONNECTIONS:
            return
        self._seen[plain] = None
        if number not in self.wanted and self._is_wanted(channel):
            self._room -= len(definition)
            if self._room > 0:
                self.wanted[number] = channel


def read_bag(path: Path, wanted: Wanted, seen: dict[Channel, None], loss: Loss) -> Messages:
    """The messages of a bag of ROS 1 on the topics that are wanted, as far as it can be read.

    ``seen`` takes every topic that the bag names, ``loss`` what is left out.
    """
    connections, size = _Connections(wanted, seen), path.stat().st_size
    chunks = Chunks(size, loss)
    with path.open("rb") as file:
        file.readline(64)  # its version
        while not loss.stopped and file.tell() < size:
            fields, length = _header(file)
            loss.look()
            if fields is None:
                loss.cut("what was to come behind the end of the file, or behind damage")
                return
            end = file.tell() + length
            kind = fields.get(b"op")
            if kind == _CHUNK:
                packing = _CHUNK_PACKINGS.get(fields.get(b"compression", b""))
                becomes = int.from_bytes(fields.get(b"size", b"")[:4], "little")
                if packing is None:
                    loss.add("chunks whose packing is not known")
                else:
                    with chunks.opened(io.BufferedReader(Part(file, length), MIB), packing, becomes) as stream:
                        yield from _records(stream, connections, loss)
            elif kind in (_MESSAGE, _CONNECTION):
                yield from _record(file, fields, length, connections, loss)
            if end > size:
                loss.cut("what was to come behind the end of the file")
                return
            file.seek(end)


def _records(stream: IO[bytes], connections: _Connections, loss: Loss) -> Messages:
    """The messages of a chunk."""
    while not loss.stopped:
        fields, length = _header(stream)
        loss.look()
        if fields is None:
            if length:
                loss.add(DAMAGED)
            return
        yield from _record(stream, fields, length, connections, loss)


def _header(stream: IO[bytes]) -> tuple[dict[bytes, bytes] | None, int]:
    """The fields of a record, and how many bytes of content follow; None and 0 at the end, None and 1 at damage."""
    begin = stream.read(4)
    if len(begin) < 4:
        return None, len(begin[:1])
    (length,) = struct.unpack("<I", begin)
    data = stream.read(length) if length <= _MOST_HEADER else b""
    content = stream.read(4)
    fields = _fields(data)
    if len(data) < length or len(content) < 4 or not fields:
        return None, 1
    return fields, struct.unpack("<I", content)[0]


def _fields(data: bytes) -> dict[bytes, bytes] | None:
    """Names and values of a header; None for one that is damaged."""
    found, at = {}, 0
    while at < len(data):
        if at + 4 > len(data):
            return None
        (size,) = struct.unpack_from("<I", data, at)
        name, sign, value = data[at + 4 : at + 4 + size].partition(b"=")
        at += 4 + size
        if not sign or at > len(data):
            return None
        found[name] = value
    return found


def _record(
    stream: IO[bytes], fields: dict[bytes, bytes], length: int, connections: _Connections, loss: Loss
) -> Messages:
    """Take a connection, or give a message that is wanted; the stream is behind it then."""
    number, kind = fields.get(b"conn", b""), fields.get(b"op")
    needed = kind == _CONNECTION or (kind == _MESSAGE and number in connections.wanted)
    most = MIB if kind == _CONNECTION else MOST_MESSAGE
    if not needed or length > most:
        skip(stream, length)
        if needed:
            loss.beyond(f"messages larger than {most >> 10} KiB")
        return
    data = stream.read(length)
    if len(data) < length:
        return  # the file or the chunk ends, which is said there
    if kind == _CONNECTION:
        described = _fields(data)
        if described is None:
            loss.add("descriptions of topics that are damaged")
        else:
            connections.add(number, fields.get(b"topic", b""), described)
    elif len(time := fields.get(b"time", b"")) == 8:
        seconds, nanoseconds = struct.unpack("<II", time)
        yield connections.wanted[number], seconds * 10**9 + nanoseconds, data
    else:
        loss.add("messages that cannot be read")


def storage_of(folder: Path, loss: Loss) -> list[Path]:
    """The files of a folder, a bag of ROS 2, that hold its messages, in their order."""
    found = [path for path in folder.iterdir() if path.name.lower().endswith(STORAGE) and path.is_file()]
    described = folder / BAG
    if described.is_file():
        with described.open("rb") as file:
            text = file.read(MIB).decode("utf-8", "replace")
        for name in _NAMED.findall(text):
            if not any(path.name.startswith(PurePosixPath(name).name) for path in found):
                loss.cut(f"{name}, which {BAG} names and which is not there")
    return sorted(found, key=lambda path: in_order(path.name))


def read_database(path: Path, wanted: Wanted, seen: dict[Channel, None], loss: Loss) -> Messages:
    """The messages of a bag of ROS 2 in sqlite3, as far as the database can be read; as :func:`read_bag` otherwise."""
    steps = iter(range(_MOST_STEPS))
    name = quote(os.fsencode(path.absolute()))  # of bytes: a name need not be UTF-8
    database = sqlite3.connect(f"file:{name}?mode=ro&immutable=1", uri=True)
    try:
        database.set_progress_handler(lambda: next(steps, None) is None, _STEPS)
        database.text_factory = lambda text: text.decode("utf-8", "replace")
        yield from _rows(database, wanted, seen, loss)
    except (sqlite3.Error, OverflowError, UnicodeDecodeError) as error:  # the last where an error quotes damaged text
        loss.cut("what sqlite cannot read", error)
    finally:
        database.close()


def _rows(database: sqlite3.Connection, wanted: Wanted, seen: dict[Channel, None], loss: Loss) -> Messages:
    for table, columns in _COLUMNS.items():
        if not _has(database, table, columns):
            loss.cut(f"all, because no table {table} of messages of ROS is in the database")
            return
    definitions: dict[str, str] = {}
    if _has(database, "message_definitions", _DEFINED):
        query = f"SELECT {', '.join(_DEFINED)} FROM message_definitions LIMIT {_MOST_CONNECTIONS}"
        for kind, encoding, text in database.execute(query):
            if isinstance(kind, str) and encoding == "ros2msg" and isinstance(text, str) and len(text) <= MIB:
                definitions[short(kind)] = text
    channels = {}
    for number, topic, kind in database.execute(f"SELECT id, name, type FROM topics LIMIT {_MOST_CONNECTIONS}"):
        if not (isinstance(number, int) and isinstance(topic, str) and isinstance(kind, str)):
            loss.add("topics that are damaged")
            continue
        channel = Channel(topic[:MOST_NAME], short(kind[:MOST_NAME]), CDR, definitions.get(short(kind), ""))
        seen[channel._replace(definition="")] = None
        if wanted(channel):
            channels[number] = channel
    small = "CASE WHEN length(data) <= ? THEN data END"  # what is larger is not loaded
    query = f"SELECT topic_id, timestamp, typeof(data), length(data), {small} FROM messages"
    for number, time_ns, kind, length, data in database.execute(query, (MOST_MESSAGE,)):
        if loss.stopped:
            return
        if number not in channels:
            continue
        if kind != "blob" or not isinstance(time_ns, int):
            loss.add("messages that cannot be read")
        elif length > MOST_MESSAGE:
            loss.beyond(f"messages larger than {MOST_MESSAGE >> 10} KiB")
        else:
            yield channels[number], time_ns, data


def _has(database: sqlite3.Connection, table: str, columns: tuple[str, ...]) -> bool:
    """Whether a table is stored with these columns: a view or a column that is computed may become anything."""
    query = "SELECT count(*) FROM sqlite_master WHERE type = 'table' AND name = ? AND sql LIKE 'CREATE TABLE%'"
    if not database.execute(query, (table,)).fetchone()[0]:
        return False
    stored = {name for _, name, *_, hidden in database.execute(f"PRAGMA table_xinfo({table})") if not hidden}
    return set(columns) <= stored
