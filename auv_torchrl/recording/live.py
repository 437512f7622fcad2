"""A flight that goes on, in the viewer: the vehicle, its path, what it is commanded, what its thrusters give."""

import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from auv_torchrl.palette import U_S, rgb
from auv_torchrl.recording.body import record_hull, record_motion
from auv_torchrl.recording.series import thruster_series
from auv_torchrl.vehicle import Vehicle

EVERY_S = 0.05  # of the flight between two rows: 20 pictures a second at the speed of reality
SEND_S = 0.1  # of the wall clock after which rows are sent
_MOST_ROWS = 1000  # that wait at most
_TIMELINE = "time"
_ALL = rrb.TimeRangeBoundary.infinite()
_UP_TO_NOW = rrb.TimeRangeBoundary.cursor_relative()


class Row(NamedTuple):
    """One moment of a flight."""

    time_s: float  # on a timeline that never goes back
    position: np.ndarray  # (3,) m, NED
    quaternion: np.ndarray  # (4,) w x y z, body to earth
    command: Sequence[float]  # (n,) as sent
    thrust: np.ndarray  # (n,) N


class LiveRecording:
    """Sends a flight to streams while it goes on.

    Args:
        streams: to a viewer, or into memory.
        vehicle: for the places and directions of its thrusters, no batch.
        clock: in s.
    """

    def __init__(
        self,
        streams: Sequence[rr.RecordingStream],
        vehicle: Vehicle,
        clock: Callable[[], float] = time.monotonic,
    ):
        self._streams, self._vehicle, self._clock = streams, vehicle, clock
        self._rows: list[Row] = []
        self._last: np.ndarray | None = None  # where the path ends that was sent
        self._next_s, self._sent_s = -np.inf, clock()
        names, colours = thruster_series(vehicle.thrusters)
        for stream in streams:
            stream.send_blueprint(live_blueprint(), make_active=True)
            stream.log("world", rr.ViewCoordinates.FRD, static=True)  # x north, y east, z down
            record_hull(stream, "world/vehicle", vehicle, U_S)
            for entity in ("command", "thrust"):
                stream.log(entity, rr.SeriesLines(names=names, colors=colours), static=True)

    def wants(self, time_s: float) -> bool:
        """Whether a row at this time is shown."""
        return time_s >= self._next_s

    def add(self, row: Row) -> None:
        """Show a row; it is sent with those of the next moments."""
        self._next_s = row.time_s + EVERY_S
        self._rows.append(row)
        if self._clock() - self._sent_s >= SEND_S or len(self._rows) >= _MOST_ROWS:
            self.send()

    def begin(self, time_s: float, text: str) -> None:
        """A vehicle is placed: its path begins anew."""
        self.send()
        self._last, self._next_s = None, -np.inf
        for stream in self._streams:
            stream.set_time(_TIMELINE, duration=time_s)
            stream.log("happened", rr.TextLog(text))
            stream.reset_time()

    def send(self) -> None:
        """Send what waits."""
        self._sent_s = self._clock()
        if not self._rows:
            return
        times, position, quaternion, command, thrust = (np.array(column) for column in zip(*self._rows, strict=True))
        self._rows.clear()
        time_column = rr.TimeColumn(_TIMELINE, duration=times)
        path = position if self._last is None else np.concatenate((self._last[None], position))
        self._last = position[-1]
        for stream in self._streams:
            record_motion(stream, "world/vehicle", self._vehicle, time_column, position, quaternion, thrust)
            for entity, values in (("command", command), ("thrust", thrust)):
                scalars = rr.Scalars.columns(scalars=values.reshape(-1)).partition([values.shape[1]] * len(times))
                stream.send_columns(entity, [time_column], scalars)
            depth = rr.Scalars.columns(scalars=position[:, 2])
            stream.send_columns("depth", [time_column], depth)
            stream.set_time(_TIMELINE, duration=float(times[-1]))
            stream.log("world/path", rr.LineStrips3D([path], colors=[rgb(U_S)], radii=0.004))
            stream.reset_time()


def live_blueprint() -> rrb.Blueprint:
    """The vehicle and its path on the left, depth, commands and thrusts on the right, all times up to now."""
    so_far = rrb.VisibleTimeRange(_TIMELINE, start=_ALL, end=_UP_TO_NOW)
    scene = rrb.Spatial3DView(
        origin="world",
        name="Flight, NED in m",
        background=[255, 255, 255],
        line_grid=rrb.LineGrid3D(visible=True, spacing=0.5, color=[0, 0, 0, 40]),
        overrides={"world/path": rrb.VisibleTimeRanges([so_far])},
    )
    curves = [
        rrb.TimeSeriesView(origin=origin, name=name, time_ranges=so_far)
        for origin, name in (("depth", "Depth in m"), ("command", "Commands, as sent"), ("thrust", "Thrust in N"))
    ]
    happened = rrb.TextLogView(origin="happened", name="What happened")
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Vertical(scene, happened, row_shares=[4, 1]), rrb.Vertical(*curves)),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline=_TIMELINE, play_state="following"),
    )
