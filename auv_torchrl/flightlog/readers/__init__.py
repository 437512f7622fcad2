"""Readers of the logs that vehicles write: one file each, chosen by content and suffix."""

import os
from dataclasses import replace
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

from auv_torchrl.flightlog.findings import FlightLogError
from auv_torchrl.flightlog.readers import mapped, mcap, mcap_records, tlog, ulog, ulog_records
from auv_torchrl.flightlog.readers.ardupilot import ardupilot, dataflash, dataflash_text
from auv_torchrl.flightlog.readers.packed_log import bare, unpacked
from auv_torchrl.flightlog.readers.reader import Reader, choose_reader
from auv_torchrl.flightlog.readers.ros import ros
from auv_torchrl.flightlog.streams.stream import ReadOptions, Streams
from auv_torchrl.registry import Registry

if TYPE_CHECKING:
    from auv_torchrl.flightlog.tables.table import Table

_MAPPED = ("ROS bag", "MCAP recording")  # readers of recordings whose messages may be an owner's own
TABLES = (".csv", ".parquet", ".pq")  # how tables are called


def _read_dataflash(path: Path, options: ReadOptions) -> Streams:
    return ardupilot.streams_of(path.name, "ArduPilot DataFlash", dataflash.read_messages(path, ardupilot.WANTED))


def _read_dataflash_text(path: Path, options: ReadOptions) -> Streams:
    messages = dataflash_text.read_messages(path, ardupilot.WANTED)
    return ardupilot.streams_of(path.name, "ArduPilot DataFlash as text", messages)


READERS = Registry(
    "readers",
    Reader,
    (
        Reader("ArduPilot DataFlash log", (".bin",), lambda head: head.startswith(dataflash.MAGIC), _read_dataflash),
        Reader("ArduPilot DataFlash log as text", (".log",), dataflash_text.recognizes, _read_dataflash_text),
        Reader("PX4 log", (".ulg",), lambda head: head.startswith(ulog_records.MAGIC), ulog.read),
        Reader("MCAP recording", (".mcap",), lambda head: head.startswith(mcap_records.MAGIC), mcap.read),
        Reader("ROS bag", (".bag", ".db3"), ros.recognizes, ros.read, ros.is_bag),
        Reader("MAVLink telemetry", (".tlog",), tlog.recognizes, tlog.read),
    ),
    name=".+",  # for people
)


def read_log(path: str | os.PathLike[str], options: ReadOptions | None = None) -> "Streams | Table":
    """Everything that a log holds, packed or not: streams of a vehicle's own log, or a table (CSV, Parquet).

    A table or a recording whose columns or messages a mapping explains is read as streams.

    Raises:
        FlightLogError: if nothing of the file can be used.
    """
    with unpacked(Path(path), _is_log) as (log, findings):
        reader, options = choose_reader(log, READERS), options or ReadOptions()
        if reader is None:
            from auv_torchrl.flightlog.tables.table import read_table  # here, not above: it loads pyarrow

            table = read_table(log)
            read = mapped.streams_of_table(table, options.mapping) if options.mapping else table
        elif options.mapping:
            if reader.name not in _MAPPED:
                raise FlightLogError(
                    f"{log.name} is a {reader.name}, which says itself what it holds: leave mapping out"
                )
            read = mapped.streams_of_recording(log, options.mapping)
        else:
            read = reader.read(log, options)
    return replace(read, findings=(*findings, *read.findings)) if findings else read


def read_streams(path: str | os.PathLike[str], options: ReadOptions | None = None) -> Streams | None:
    """Everything that a log of a vehicle's own holds; None for a table (CSV, Parquet).

    Raises:
        FlightLogError: if nothing of the file can be used.
    """
    read = read_log(path, options)
    return read if isinstance(read, Streams) else None


def is_log_name(name: str) -> bool:
    """Whether the name of a file is that of a log, packed or not."""
    suffix = PurePath(bare(name)).suffix.lower()
    known = suffix in TABLES or any(suffix in reader.suffixes for reader in READERS.values())
    return known or name.lower().endswith(".zip")


def _is_log(name: str, head: bytes) -> bool:
    """Whether a member of an archive is a log; its name alone says so of a table."""
    return PurePath(bare(name)).suffix.lower() in TABLES or any(reader.recognizes(head) for reader in READERS.values())


__all__ = ["READERS", "Reader", "choose_reader", "is_log_name", "read_log", "read_streams"]
