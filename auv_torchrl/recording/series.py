"""Curves over time in the viewer, and where the vehicle should be."""

from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

from auv_torchrl.palette import SERIES, rgb

if TYPE_CHECKING:
    from auv_torchrl.flight import Flight

Colour = tuple[int, int, int, int]
_BLACK = (0, 0, 0)
_FAINT = (0, 0, 0, 90)


def time_of(flight: "Flight") -> rr.TimeColumn:
    """The times of one flight, batch (T + 1)."""
    return rr.TimeColumn("time", duration=flight.time.double().numpy())


def thruster_series(count: int) -> tuple[list[str], list[Colour]]:
    """Names and colours of the curves of thrusters."""
    return [f"thruster {i + 1}" for i in range(count)], [rgb(SERIES[i % len(SERIES)]) for i in range(count)]


def record_series(
    recording: rr.RecordingStream, entity: str, flight: "Flight", values: np.ndarray, names: list[str],
    colours: list[Colour], width: float = 1.5,
) -> None:  # fmt: skip
    """Log (T + 1, k) numbers along one flight as k curves of one entity."""
    style = rr.SeriesLines(names=names, colors=colours, widths=[width] * len(names))
    recording.log(entity, style, static=True)
    samples, count = values.shape
    columns = rr.Scalars.columns(scalars=values.reshape(-1))
    recording.send_columns(entity, [time_of(flight)], columns.partition([count] * samples) if count > 1 else columns)


def record_reference(recording: rr.RecordingStream, entity: str, flight: "Flight") -> None:
    """Log the reference of one flight, batch (T + 1)."""
    place = flight.reference_position.double().numpy()
    recording.log(f"{entity}/point", rr.Points3D([[0, 0, 0]], radii=0.03, colors=[_BLACK]), static=True)
    if not flight.moving:
        recording.log(f"{entity}/point", rr.Transform3D(translation=place[0]), static=True)
        return
    recording.log(f"{entity}/path", rr.LineStrips3D([place], colors=[_FAINT], radii=0.012), static=True)
    recording.send_columns(f"{entity}/point", [time_of(flight)], rr.Transform3D.columns(translation=place))
