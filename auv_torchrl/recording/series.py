"""Curves over time in the viewer."""

import numpy as np
import rerun as rr

Colour = tuple[int, int, int, int]


def record_series(
    recording: rr.RecordingStream, entity: str, time: rr.TimeColumn, values: np.ndarray, names: list[str],
    colours: list[Colour], width: float = 1.5,
) -> None:  # fmt: skip
    """Log (T + 1, k) numbers as k curves of one entity."""
    style = rr.SeriesLines(names=names, colors=colours, widths=[width] * len(names))
    recording.log(entity, style, static=True)
    samples, count = values.shape
    columns = rr.Scalars.columns(scalars=values.reshape(-1))
    recording.send_columns(entity, [time], columns.partition([count] * samples) if count > 1 else columns)
