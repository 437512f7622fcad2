"""What a log of a vehicle's own holds, for tests."""

from pathlib import Path

from auv_torchrl.flightlog.readers import read_streams
from auv_torchrl.flightlog.streams.stream import ReadOptions, Streams


def streams_of(path: Path, options: ReadOptions | None = None) -> Streams:
    """Of a file that is no table."""
    streams = read_streams(path, options)
    assert streams is not None
    return streams
