"""Flights through the link in the rerun viewer, live and as a file."""

import logging
from collections.abc import Sequence
from pathlib import Path

import rerun as rr

from auv_torchrl.link.plant import Moment
from auv_torchrl.recording.file import write_recording
from auv_torchrl.recording.live import LiveRecording, Row
from auv_torchrl.vehicle import Vehicle

log = logging.getLogger(__name__)

RECORDING = "run.rrd"
_NAME = "auv_torchrl sim"


class Viewer:
    """Shows flights where ``rerun=`` says, and writes ``run.rrd`` into the output folder.

    Args:
        vehicle: nominal, no batch.
        show: false, true for a viewer that is started here, or the address of one that is there, ``rerun+http://...``.
        folder: of the file; None for none.

    Raises:
        ValueError: where no viewer can be started or reached.
    """

    def __init__(self, vehicle: Vehicle, show: bool | str, folder: Path | None):
        self._streams: list[rr.RecordingStream] = []
        self._path = None if folder is None else folder / RECORDING
        if show:
            self._streams.append(_shown(show))
        if folder is not None:
            self._streams.append(rr.RecordingStream(_NAME))
            self._memory = self._streams[-1].memory_recording()
        self._recording = LiveRecording(self._streams, vehicle)
        self._before_s = self._now_s = 0.0  # of all vehicles before this one; with it

    def begin(self, moment: Moment) -> None:
        """A vehicle was placed."""
        self._before_s = self._now_s
        self._recording.begin(self._now_s, "the vehicle was placed, at 0 s of its own time")

    def flown(self, command: Sequence[float], moment: Moment) -> None:
        """A step was flown."""
        self._now_s = self._before_s + moment.time_s
        if self._recording.wants(self._now_s):
            position, quaternion = (part[0] for part in moment.state[:2])
            self._recording.add(Row(self._now_s, position, quaternion, command, moment.thrust[0]))

    def close(self) -> None:
        """Send what waits, and write the file."""
        self._recording.send()
        if self._path is not None:
            write_recording(self._memory, self._path)
        for stream in self._streams:
            stream.disconnect()


def _shown(show: bool | str) -> rr.RecordingStream:
    stream = rr.RecordingStream(_NAME)
    try:
        if isinstance(show, str):
            stream.connect_grpc(show)
        else:
            stream.spawn()
    except (RuntimeError, ValueError, OSError) as error:
        where = show if isinstance(show, str) else "true, a viewer of its own"
        raise ValueError(
            f"rerun={where} cannot be shown ({error}): give rerun=true, rerun=rerun+http://127.0.0.1:9876/proxy of a "
            "viewer that runs, or rerun=false"
        ) from error
    return stream
