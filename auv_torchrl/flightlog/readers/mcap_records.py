"""The records of an MCAP file, chunk by chunk and never a whole chunk at once: https://mcap.dev/spec."""

import io
import struct
from pathlib import Path
from typing import IO

from auv_torchrl.flightlog.readers.bounds import MIB, MOST_MESSAGE, MOST_NAME, Loss, Part, skip
from auv_torchrl.flightlog.readers.packings import DAMAGED, PACKINGS, Chunks
from auv_torchrl.flightlog.readers.recording import Channel, Messages, Wanted, short
from auv_torchrl.quantities import counted

MAGIC = b"\x89MCAP"
_MAGIC_BYTES = 8
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 2, 3, 4, 5, 6, 15
_HEAD = struct.Struct("<BQ")  # kind and length of a record
_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, times of receiving and of sending in ns
_CHUNK_HEAD = struct.Struct("<QQQII")  # first and last time, size, sum, length of the name of the packing
_MOST_SEEN = 10_000  # channels that are named; numbers of channels have 16 bits, but may be given anew
_MOST_SCHEMAS = 16 * MIB  # bytes of all definitions of types; ROS has some kB of each


class _Index:
    """Channels and schemas by number."""

    def __init__(self, wanted: Wanted, seen: dict[Channel, None]) -> None:
        self.wanted: dict[int, Channel] = {}
        self._schemas: dict[int, tuple[str, str]] = {}
        self._size = 0
        self._is_wanted, self._seen = wanted, seen

    def schema(self, data: bytes) -> None:
        """Take a schema, as far as there is room."""
        (number,) = struct.unpack_from("<H", data)
        name, at = _text(data, 2)
        encoding, at = _text(data, at)
        definition = _text(data, at)[0] if encoding == "ros2msg" or encoding == "ros1msg" else ""
        if number not in self._schemas and self._size + len(definition) <= _MOST_SCHEMAS:
            self._size += len(definition) + len(name)
            self._schemas[number] = (name[:MOST_NAME], definition)

    def channel(self, data: bytes) -> None:
        """Take a channel."""
        number, schema = struct.unpack_from("<HH", data)
        topic, at = _text(data, 4)
        encoding, _ = _text(data, at)
        kind, definition = self._schemas.get(schema, ("", ""))
        channel = Channel(topic[:MOST_NAME], short(kind), encoding[:MOST_NAME], definition)
        if len(self._seen) < _MOST_SEEN:
            self._seen[channel._replace(definition="")] = None
        if self._is_wanted(channel):
            self.wanted[number] = channel


def read_messages(path: Path, wanted: Wanted, seen: dict[Channel, None], loss: Loss) -> Messages:
    """The messages of the channels that are wanted, as far as the file can be read.

    Args:
        path: the file.
        wanted: whether a channel is.
        seen: takes every channel that the file names.
        loss: takes what is left out.
    """
    index, size = _Index(wanted, seen), path.stat().st_size
    chunks = Chunks(size, loss)
    with path.open("rb") as file:
        file.seek(_MAGIC_BYTES)
        while not loss.stopped:
            head = file.read(_HEAD.size)
            if len(head) < _HEAD.size:
                loss.cut("what was to come behind the end of the file")
                return
            kind, length = _HEAD.unpack(head)
            loss.look()
            if not kind:
                loss.cut("what is behind damage")
                return
            end = file.tell() + length
            if kind in (_FOOTER, _DATA_END):
                file.seek(max(size - _MAGIC_BYTES, 0))
                if not file.read().startswith(MAGIC):
                    loss.cut("the index at the end of the file")
                return
            if kind == _CHUNK:
                part = io.BufferedReader(Part(file, length), MIB)
                packing, becomes = _chunk_head(part)
                if packing is None:
                    loss.add("chunks whose head is damaged or whose packing is not known")
                else:
                    with chunks.opened(part, packing, becomes) as stream:
                        yield from _records(stream, index, loss)
            elif kind in (_SCHEMA, _CHANNEL, _MESSAGE):
                yield from _record(file, kind, length, index, loss)
            if end > size:
                loss.cut("what was to come behind the end of the file")
                return
            file.seek(end)


def _chunk_head(part: IO[bytes]) -> tuple[str | None, int]:
    """How a chunk is packed, nothing for one that is not, and what it says it becomes; what it holds comes next.

    None where the packing is not known.
    """
    head = part.read(_CHUNK_HEAD.size)
    if len(head) < _CHUNK_HEAD.size:
        return None, 0
    _, _, becomes, _, length = _CHUNK_HEAD.unpack(head)
    name = part.read(min(length, MOST_NAME)).decode("utf-8", "replace")
    return name if len(part.read(8)) == 8 and (not name or name in PACKINGS) else None, becomes


def _records(stream: IO[bytes], index: _Index, loss: Loss) -> Messages:
    """The messages of a chunk."""
    while not loss.stopped:
        head = stream.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return
        kind, length = _HEAD.unpack(head)
        loss.look()
        if not kind:
            loss.add(DAMAGED)
            return
        if kind in (_SCHEMA, _CHANNEL, _MESSAGE):
            yield from _record(stream, kind, length, index, loss)
        elif not skip(stream, length):
            return


def _record(stream: IO[bytes], kind: int, length: int, index: _Index, loss: Loss) -> Messages:
    """Take a record of the index, or give a message that is wanted; the stream is behind it then."""
    most = MOST_MESSAGE if kind == _MESSAGE else MIB
    data = stream.read(min(length, most))
    skipped = length <= most or skip(stream, length - most)
    if len(data) < min(length, most) or not skipped:
        return  # the file or the chunk ends, which is said there
    if kind == _MESSAGE:
        if length < _MESSAGE_HEAD.size:
            loss.add("messages that cannot be read")
            return
        number, _, received, _ = _MESSAGE_HEAD.unpack_from(data)
        channel = index.wanted.get(number)
        if channel is None:
            return
        if length > most:
            loss.beyond(f"messages larger than {most >> 10} KiB")
        else:
            yield channel, received, data[_MESSAGE_HEAD.size :]
        return
    try:
        if length > most:
            raise ValueError(counted(length, "byte"))
        (index.schema if kind == _SCHEMA else index.channel)(data)
    except (struct.error, ValueError):  # UnicodeDecodeError is one
        loss.add("descriptions of channels that are damaged")


def _text(data: bytes, at: int) -> tuple[str, int]:
    (length,) = struct.unpack_from("<I", data, at)
    end = at + 4 + length
    if end > len(data):
        raise ValueError(f"a text of {counted(length, 'byte')} in {len(data)}")
    return data[at + 4 : end].decode(), end
