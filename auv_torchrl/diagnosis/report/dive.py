"""The whole log in one picture: depth, heading, commands and volts, with what was held out and when a change set in."""

import math
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from markupsafe import Markup

from auv_torchrl.diagnosis.report.svg import line, polyline, rect, svg, text, ticks
from auv_torchrl.diagnosis.verdict import Overview
from auv_torchrl.flightlog.log import Floats

_WIDTH, _LEFT, _RIGHT = 1040.0, 84.0, 8.0
# Heights: of the title of a curve, of the curve, of what is between strips, of the row of a thruster.
_TITLE, _STRIP, _GAP, _THRUSTER = 15.0, 62.0, 8.0, 11.0
_CELLS = 240  # of a row of commands at most
_PAUSE = 8.0  # times the usual distance of two samples: from there on, nothing is drawn between them


def dive(overview: Overview, held_out: Sequence[tuple[float, float]] = (), onset_s: float | None = None) -> Markup:
    """The picture.

    Args:
        overview: of the log.
        held_out: stretches that no fit has used, from and to in s into the log.
        onset_s: s into the log at which the vehicle changed.
    """
    strips = [
        (title, -values if title == "depth, m" else values)
        for title, values in (
            ("depth, m", overview.depth),
            ("heading, °", np.degrees(overview.heading)),
            ("battery, V", overview.volts),
        )
        if np.isfinite(values).any()
    ]
    rows = overview.commands.shape[1]
    each = _TITLE + _STRIP + _GAP
    commands = len(strips) * each
    height = commands + rows * _THRUSTER + _GAP + 20
    start, stop = float(overview.t[0]), float(overview.t[-1])

    def across(t: float) -> float:
        return _LEFT + (t - start) / max(stop - start, 1e-9) * (_WIDTH - _LEFT - _RIGHT)

    parts = [
        rect(across(a), 0, across(b) - across(a), height - 20, "held", 0)
        for a, b in ((max(a, start), min(b, stop)) for a, b in held_out)
        if b > a
    ]
    parts += [line(across(t), 0, across(t), height - 20, "grid") for t in overview.begins[1:]]
    for place, (title, values) in enumerate(strips):
        parts += _curve(title, values, overview.t, across, place * each + _TITLE)
    for thruster in range(rows):
        y = commands + thruster * _THRUSTER
        parts.append(text(_LEFT - 6, y + 9, f"thruster {thruster + 1}", "tick", "end"))
        parts += _cells(overview.t, overview.commands[:, thruster], across, y)
    if onset_s is not None:
        parts += [line(across(onset_s), 0, across(onset_s), height - 20, "onset"),
                  text(across(onset_s) + 4, 10, "it changes here", "onset")]  # fmt: skip
    parts += [text(across(tick), height - 6, f"{tick:g} s", "tick", "middle") for tick in ticks(start, stop, 10)]
    named = ", ".join([*(title.split(",")[0] for title, _ in strips), "commands"])
    return svg(_WIDTH, height, f"The whole log over time: {named}", parts, "dive")


def _longest(t: Floats) -> float:
    """Seconds between two samples, beyond which the log pauses."""
    return _PAUSE * float(np.median(np.diff(t))) if len(t) > 1 else math.inf


def _curve(title: str, values: Floats, t: Floats, across: Callable[[float], float], top: float) -> Iterable[str]:
    """A strip with a curve below its title; depth counts downwards, so that the picture does."""
    seen = values[np.isfinite(values)]
    low, high = float(seen.min()), float(seen.max())
    margin = max(0.08 * (high - low), 1e-3)
    low, high = low - margin, high + margin
    ys = top + _STRIP * (high - values) / (high - low)
    yield text(_LEFT, top - 4, title, "title")
    for tick in ticks(low, high, 2):
        y = top + _STRIP * (high - tick) / (high - low)
        yield line(_LEFT, y, _WIDTH - _RIGHT, y, "grid")
        yield text(_LEFT - 6, y + 3.5, f"{abs(tick) if title.startswith('depth') else tick:g}", "tick", "end")
    xs = [across(one) for one in t.tolist()]
    jumps = np.diff(t) > _longest(t)
    if title.startswith("heading"):
        jumps |= np.abs(np.diff(values)) > 180
    # The pen is lifted over a pause, and where the compass goes round.
    for place in np.flatnonzero(jumps)[::-1].tolist():
        xs.insert(place + 1, xs[place])
        ys = np.insert(ys, place + 1, math.nan)
    yield polyline(xs, ys.tolist(), "curve after")


def _cells(t: Floats, commands: Floats, across: Callable[[float], float], top: float) -> Iterable[str]:
    """A row whose cells are the darker the larger the command, of one colour forwards and another backwards."""
    edges = np.linspace(0, len(t), min(_CELLS, len(t)) + 1).astype(int)
    for first, last in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        part = commands[first:last]
        value = float(part[np.abs(part).argmax()]) if len(part) else 0.0
        if not abs(value) > 0.02:
            continue
        behind = min(float(t[min(last, len(t) - 1)]), float(t[last - 1]) + _longest(t))
        left, right = across(float(t[first])), across(behind)
        opacity = 0.15 + 0.85 * min(abs(value), 1.0)
        way = "forwards" if value > 0 else "backwards"
        yield rect(left, top + 1, max(right - left, 0.5), _THRUSTER - 2, way, 0).replace(
            "/>", f' fill-opacity="{opacity:.2f}"/>'
        )
