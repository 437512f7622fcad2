"""Readers of the logs that vehicles write: one file each, chosen by content and suffix."""

import os
from pathlib import Path

from auv_torchrl.flightlog.readers import ardupilot, dataflash, dataflash_text, mcap, ros, tlog, ulog
from auv_torchrl.flightlog.readers.reader import Reader, choose_reader
from auv_torchrl.flightlog.streams.stream import ReadOptions, Streams
from auv_torchrl.registry import Registry


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
        Reader("PX4 log", (".ulg",), lambda head: head.startswith(ulog.MAGIC), ulog.read),
        Reader("MCAP recording", (".mcap",), lambda head: head.startswith(mcap.MAGIC), mcap.read),
        Reader("ROS bag", (".bag", ".db3"), ros.recognizes, ros.read, ros.is_bag),
        Reader("MAVLink telemetry", (".tlog",), tlog.recognizes, tlog.read),
    ),
    name=".+",  # for people
)


def read_streams(path: str | os.PathLike[str], options: ReadOptions | None = None) -> Streams | None:
    """Everything that a log holds; None for a table (CSV, Parquet), which is no log of a vehicle's own.

    Raises:
        FlightLogError: if nothing of the file can be used.
    """
    path = Path(path)
    reader = choose_reader(path, READERS)
    return None if reader is None else reader.read(path, options or ReadOptions())


__all__ = ["READERS", "Reader", "choose_reader", "read_streams"]
