"""Curves of a dive over time: kept in full beside the log, and thinned to what a screen can show.

A thinned curve keeps the least and the greatest value of each stretch, so that no peak is lost.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from auv_torchrl.extras import library
from auv_torchrl.flightlog.streams.stream import Floats, Streams

if TYPE_CHECKING:
    from auv_torchrl.flightlog.tables.table import Table  # which loads more than the server needs

FILE = "overview.npz"
MOST_POINTS = 1200  # of a curve that a browser gets
_MOST_KEPT = 200_000  # samples of a curve on disk: 2 h at 25 Hz
_MOST_EPISODES = 2000  # whose times are kept
_PAUSE_S = 1.0  # between episodes, which a table counts from 0 each
_DEGREES = 180 / np.pi
_NAMES = {"roll": "roll", "pitch": "pitch", "yaw": "heading"}


@dataclass(frozen=True)
class Panel:
    """Curves over the same time that share one axis."""

    title: str
    unit: str
    t: Floats  # (T,) s
    series: Mapping[str, Floats]  # (T,) each


def panels_of_streams(streams: Streams, table: "Table | None") -> list[Panel]:
    """What a vehicle's own log shows; the commands are those of the ``table`` of the diagnosis, where there is one."""
    found = streams.streams
    panels = []
    depth = found.get("depth") or found.get("position")
    if depth is not None and "z" in depth.channels:
        panels.append(Panel("Depth", "m", depth.t, {"depth": depth.values[:, depth.channels.index("z")]}))
    if (attitude := found.get("attitude")) is not None:
        named = {_NAMES.get(name, name): attitude.values[:, i] * _DEGREES for i, name in enumerate(attitude.channels)}
        panels.append(Panel("Attitude", "°", attitude.t, named))
    if table is not None:
        panels += _commands(table.columns["t"], table.columns)
    elif (outputs := found.get("outputs")) is not None:
        named = {name: outputs.values[:, i] for i, name in enumerate(outputs.channels)}
        panels.append(Panel("Outputs", "µs", outputs.t, {name: v for name, v in named.items() if _moves(v)}))
    if (battery := found.get("battery")) is not None:
        panels.append(Panel("Battery", "V", battery.t, {"volts": battery.values[:, 0]}))
    if (gyro := found.get("gyro")) is not None:
        turning: dict[str, Floats] = dict(zip(("roll", "pitch", "yaw"), gyro.values.T * _DEGREES, strict=True))
        panels.append(Panel("Turning", "°/s", gyro.t, turning))
    return [panel for panel in panels if panel.series]


def panels_of_table(table: "Table", t: Floats) -> list[Panel]:
    """What a table in the columns of the format shows, over the times ``t`` (T,) of its rows."""
    columns = table.columns
    panels = [Panel("Depth", "m", t, {"depth": columns["z"]})] if "z" in columns else []
    attitude = {name: columns[axis] * _DEGREES for axis, name in _NAMES.items() if axis in columns}
    speeds = {
        name: columns[axis] for axis, name in zip("uvw", ("surge", "sway", "heave"), strict=True) if axis in columns
    }
    place = {name: columns[axis] for axis, name in (("x", "north"), ("y", "east")) if axis in columns}
    panels += [Panel("Attitude", "°", t, attitude)] if attitude else []
    panels += _commands(t, columns)
    panels += [Panel("Battery", "V", t, {"volts": columns["battery"]})] if "battery" in columns else []
    panels += [Panel("Place", "m", t, place)] if place else []
    return panels + ([Panel("Speed", "m/s", t, speeds)] if speeds else [])


def _commands(t: Floats, columns: Mapping[str, Floats]) -> list[Panel]:
    named = {name.removeprefix("cmd_"): values for name, values in columns.items() if name.startswith("cmd_")}
    return [Panel("Commands of the thrusters", "1", t, named)] if named else []


def _moves(values: Floats) -> bool:
    finite = values[np.isfinite(values)]
    return bool(len(finite)) and bool(finite.min() < finite.max())


def times_of(table: "Table") -> tuple[Floats, dict[int, float]]:
    """(T,) s of the rows with episodes one behind the other, and by episode what was added to its times."""
    t = table.columns["t"]
    numbers, first, of_row = np.unique(table.episode, return_index=True, return_inverse=True)
    begin, end = np.full(len(numbers), np.inf), np.full(len(numbers), -np.inf)
    np.fmin.at(begin, of_row, t)
    np.fmax.at(end, of_row, t)
    finite = np.isfinite(begin) & np.isfinite(end)
    lengths = np.where(finite, end - begin, 0.0) + _PAUSE_S
    order = np.argsort(first)  # as they come in the file
    starts = np.empty(len(numbers))
    starts[order] = np.concatenate(([0.0], np.cumsum(lengths[order])[:-1]))
    added = np.where(finite, starts - begin, 0.0) if len(numbers) > 1 else np.zeros(len(numbers))
    named = {
        int(number): float(s) for number, s in zip(numbers[:_MOST_EPISODES], added, strict=False) if number == number
    }
    return t + added[of_row], named


def in_time(table: "Table", t: Floats) -> "tuple[Table, Floats]":
    """The rows that have a time, in its order."""
    rows = np.argsort(t, kind="stable")
    rows = rows[np.isfinite(t[rows])]
    return replace(table, columns={name: v[rows] for name, v in table.columns.items()}, row=table.row[rows]), t[rows]


def write_panels(path: Path, panels: Sequence[Panel]) -> None:
    """Keep the curves, as numbers alone."""
    arrays: dict[str, Any] = {"count": np.array(len(panels))}
    for i, panel in enumerate(panels):
        t, series = _thinned(panel.t, list(panel.series.values()), _MOST_KEPT)
        arrays |= {f"{i}_title": np.array(panel.title), f"{i}_unit": np.array(panel.unit), f"{i}_t": t}
        arrays |= {f"{i}_names": np.array(list(panel.series)), f"{i}_values": np.asarray(series, np.float32)}
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)


def read_panels(path: Path) -> list[Panel]:
    """What :func:`write_panels` kept."""
    with np.load(path, allow_pickle=False) as kept:
        return [
            Panel(
                str(kept[f"{i}_title"]), str(kept[f"{i}_unit"]), kept[f"{i}_t"],
                dict(zip(kept[f"{i}_names"].tolist(), kept[f"{i}_values"].astype(np.float64), strict=True)),
            )
            for i in range(int(kept["count"]))
        ]  # fmt: skip


def prediction_panels(path: Path, added: Mapping[int, float]) -> tuple[list[Panel], list[tuple[float, float]]]:
    """Errors of prediction in the held-out stretches, before and after, and from when to when these are.

    Args:
        path: of ``predictions.parquet``.
        added: by episode, what the overview adds to its times; an only episode takes any number.
    """
    read = library("pyarrow.parquet", "the errors of predictions need", "logs").read_table(path)
    column = {name: read[name].to_numpy() for name in read.schema.names}
    only = next(iter(added.values())) if len(added) == 1 else None
    offset = np.array([only if only is not None else added.get(int(n), np.nan) for n in column["episode"]], float)
    order = np.lexsort((column["t"], column["window"]))
    known = order[np.isfinite(offset[order])]
    if not len(known):
        return [], []
    t, window = column["t"][known] + offset[known], column["window"][known]
    spans = [(float(t[window == k].min()), float(t[window == k].max())) for k in np.unique(window)]
    panels = []
    for title, unit, axes, factor in (("place", "m", "x y z", 1.0), ("heading", "°", "yaw", _DEGREES)):
        series = {}
        for kind in ("before", "after"):
            apart = [column[f"{kind}_{axis}"][known] - column[f"measured_{axis}"][known] for axis in axes.split()]
            if unit == "°":
                apart = [np.angle(np.exp(1j * apart[0]))]
            seen = [values for values in apart if np.isfinite(values).any()]
            if seen:
                series[kind] = factor * np.sqrt(np.sum(np.square(seen), axis=0))
        if series:
            panels.append(_broken(Panel(f"Error of prediction: {title}", unit, t, series), window))
    return panels, spans


def _broken(panel: Panel, window: np.ndarray) -> Panel:
    """The same in the order of time, with a gap between windows."""
    parts = sorted((np.flatnonzero(window == k) for k in np.unique(window)), key=lambda rows: panel.t[rows[0]])
    t = np.concatenate([np.append(panel.t[rows], panel.t[rows[-1]] + 1e-3) for rows in parts])
    series = {name: np.concatenate([np.append(v[rows], np.nan) for rows in parts]) for name, v in panel.series.items()}
    order = np.argsort(t, kind="stable")  # windows may overlap
    return Panel(panel.title, panel.unit, t[order], {name: values[order] for name, values in series.items()})


def drawn(panels: Iterable[Panel], begin: float | None = None, end: float | None = None) -> list[dict[str, Any]]:
    """The curves from ``begin`` to ``end`` as JSON has them, thinned; a value that was not measured is null."""
    found = []
    for panel in panels:
        low = 0 if begin is None else max(int(np.searchsorted(panel.t, begin)) - 1, 0)
        high = len(panel.t) if end is None else int(np.searchsorted(panel.t, end, "right")) + 1
        t, series = _thinned(panel.t[low:high], [values[low:high] for values in panel.series.values()], MOST_POINTS)
        curves = [[None if value != value else float(f"{value:.5g}") for value in values] for values in series]
        found.append(
            {"title": panel.title, "unit": panel.unit, "t": [round(float(time), 3) for time in t],
             "series": [{"name": name, "values": curve} for name, curve in zip(panel.series, curves, strict=True)]}
        )  # fmt: skip
    return found


def _thinned(t: Floats, series: Sequence[Floats], most: int) -> tuple[Floats, list[Floats]]:
    """(T,) each, with the least and the greatest value of each of ``most`` / 2 stretches of equal length."""
    if len(t) <= most:
        return t, list(series)
    begins = np.linspace(0, len(t), most // 2, endpoint=False).astype(int)
    middle = np.append(begins[1:], len(t)) // 2 + begins // 2
    times = np.stack((t[begins], t[np.maximum(middle, begins)]), axis=-1).ravel()
    thin = [np.stack((np.fmin.reduceat(v, begins), np.fmax.reduceat(v, begins)), axis=-1).ravel() for v in series]
    return times, thin
