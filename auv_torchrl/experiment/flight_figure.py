"""flight.png: one flight from the fault to the recovery, and how the adaptation got there."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from torch import Tensor

from auv_torchrl.adaptation import PHASES, Phase
from auv_torchrl.adaptation.recovery import BACK_M, Happening
from auv_torchrl.experiment.figures import FLOOR_M, aim, bare, draw_reference, reference_key
from auv_torchrl.flight import Flight
from auv_torchrl.flightlog.signals import runs
from auv_torchrl.palette import MOMENT, NEUTRAL, SERIES, U_S, U_T
from auv_torchrl.recording import OneFlight

BEFORE_S, AFTER_S = 0.7, 1.3  # s of the close-up before the change and after the last of its moments
LEAST_S = 3.0  # s of the close-up after the change
ROW_PT, ROWS = 12, (3, 6)  # points from name to name of a moment, and between how many rows they are spread
AROUND_M = 0.5  # m around the path that is shown
FLAT_M = 0.01  # a path that goes up and down by less is shown from above alone
_AXES = ("north", "east", "down")
CHANGED = 0.05  # a gain that differs from 1 by this much is worth a colour


def flight_figure(one: OneFlight, title: str) -> Figure:
    """One flight, whole on the left, from close up around the first change on the right."""
    moving = one.adapted.flight.moving
    figure = Figure(figsize=(16 if moving else 11, 8), layout="constrained")
    figure.suptitle(title, fontsize=12)
    parts: Any = figure.subfigures(1, 2, width_ratios=[5, 11]) if moving else (None, figure)
    path, curves = parts
    grid = curves.subplots(3, 2, sharex="col", sharey="row", width_ratios=[1, 1.25])
    close = _close_up(one)
    for column in range(2):
        error, gain, statistic = grid[:, column]
        _draw_error(error, one)
        _draw_gains(gain, one)
        _draw_statistic(statistic, one)
        for axes in grid[:, column]:
            _mark(axes, one)
            bare(axes)
        statistic.set_xlabel("time in s")
    distance = f"distance to the {aim(one.adapted.flight)} in m"
    grid[0, 0].set(title="whole flight", ylabel=distance, xlim=(0, _time(one)[-1]))
    grid[0, 1].set_xlim(*close)
    rows = _name(grid[0, 1], one, close)
    grid[0, 1].set_title("from close up", pad=8 + ROW_PT * rows)
    grid[1, 0].set_ylabel("gain of a thruster")
    grid[2, 0].set_ylabel("detector's sum / threshold")
    keys = _keys(one)
    if path is not None:
        _draw_path(path, one)
        keys.append(reference_key({"": one.adapted.flight}))
        dot = Line2D([], [], marker="o", linestyle="", color=MOMENT["CHANGE"], label="where the vehicle changes")
        keys.append(dot)
    figure.legend(handles=keys, loc="outside lower center", ncols=5 if moving else 4, frameon=False)
    return figure


def _draw_path(figure: SubFigure, one: OneFlight) -> None:
    """The way of the vehicle from above, and from the south where it goes up or down."""
    wanted = one.adapted.flight.reference_position.double().numpy()
    low, high = wanted.min(axis=0) - AROUND_M, wanted.max(axis=0) + AROUND_M
    flat = np.ptp(wanted[:, 2]) < FLAT_M
    views = [(1, 0, "the path from above")] if flat else [(1, 0, "the path from above"), (1, 2, "from the south")]
    begun = next(moment for moment in one.moments if moment.happening is Happening.CHANGE)
    changed = min(int(np.searchsorted(_time(one), begun.time_s)), len(wanted) - 1)
    at = one.adapted.flight.position[changed].double().numpy()
    ratios = [float(high[up] - low[up]) for _, up, _ in views]
    grid = figure.subplots(len(views), 1, sharex=True, squeeze=False, height_ratios=ratios)[:, 0]
    for axes, (across, up, title) in zip(grid, views, strict=True):
        draw_reference(axes, one.adapted.flight, across, up)
        for flight, colour, dash, width in _flights(one):
            position = flight.position.double().numpy()
            axes.plot(position[:, across], position[:, up], dash, color=colour, linewidth=width)
        axes.plot(at[across], at[up], "o", color=MOMENT["CHANGE"], markersize=7, zorder=3)
        axes.set(title=title, xlim=(low[across], high[across]), ylim=(low[up], high[up]), aspect="equal")
        axes.set_ylabel(f"{_AXES[up]} in m")
        bare(axes)
    grid[-1].set_xlabel("east in m")
    if not flat:
        grid[-1].invert_yaxis()


def _time(one: OneFlight) -> np.ndarray:
    return one.adapted.flight.time.double().numpy()


def _flights(one: OneFlight) -> list[tuple[Flight, str, str, float]]:
    """Each flight with its colour, dashes and width, in the order of painting."""
    return [(one.alone, U_S, "--", 1.4), (one.adapted.flight, U_T, "-", 2.0)]


def _close_up(one: OneFlight) -> tuple[float, float]:
    """From shortly before the first change to shortly after it was dealt with."""
    changes = [moment.time_s for moment in one.moments if moment.happening is Happening.CHANGE]
    end = changes[1] if len(changes) > 1 else float(_time(one)[-1])
    dealt = [moment.time_s for moment in one.moments if changes[0] <= moment.time_s < end]
    return changes[0] - BEFORE_S, min(end, max(changes[0] + LEAST_S, dealt[-1] + AFTER_S))


def _draw_error(axes: Axes, one: OneFlight) -> None:
    for flight, colour, dash, width in _flights(one):
        error = flight.position_error.double().clamp(FLOOR_M, 1e3).numpy()
        axes.plot(_time(one), error, dash, color=colour, linewidth=width)
    axes.axhline(BACK_M, color=NEUTRAL, linewidth=1.0, linestyle=":")
    axes.set_yscale("log")


def _draw_gains(axes: Axes, one: OneFlight) -> None:
    time, estimated, true = _time(one), one.gains, one.true_gains
    changed = _changed(true)
    for thruster in sorted(range(true.shape[-1]), key=lambda i: i in changed):  # what matters most comes last
        coloured = thruster in changed
        colour = SERIES[thruster % len(SERIES)] if coloured else NEUTRAL
        axes.plot(time, estimated[:, thruster].numpy(), color=colour, linewidth=1.8 if coloured else 0.9)
        dashes = "black" if coloured else NEUTRAL
        axes.plot(time, true[:, thruster].numpy(), "--", color=dashes, linewidth=0.9, drawstyle="steps-pre")
    low, high = float(true.min()), float(true.max())
    axes.set_ylim(min(low, 0.0) - 0.5, max(high, 1.0) + 0.5)


def _changed(true: Tensor) -> list[int]:
    return ((true - 1.0).abs() > CHANGED).any(0).nonzero()[:, 0].tolist()


def _draw_statistic(axes: Axes, one: OneFlight) -> None:
    axes.plot(_time(one), one.adapted.statistic.numpy(), color="black", linewidth=1.4)
    axes.axhline(1.0, color=NEUTRAL, linewidth=1.0, linestyle="--")


def _mark(axes: Axes, one: OneFlight) -> None:
    """A vertical line at every moment, and a band wherever the adaptation searches."""
    for moment in one.moments:
        axes.axvline(moment.time_s, color=MOMENT[moment.happening.name], linewidth=1.6, alpha=0.9, zorder=0.5)
    searching = (one.adapted.phase == PHASES.index(Phase.SEARCHING)).numpy()
    time = _time(one)
    for begin, end in runs(searching):
        band = float(time[begin]), float(time[min(end, len(time) - 1)])
        axes.axvspan(*band, color=MOMENT["NOTICED"], alpha=0.12, linewidth=0, zorder=0)


def _name(axes: Axes, one: OneFlight, close: tuple[float, float]) -> int:
    """Names of the moments above the close-up, in rows so that neighbours stay apart, with seconds since; the rows."""
    begun = next(moment for moment in one.moments if moment.happening is Happening.CHANGE)
    within = [moment for moment in one.moments if close[0] <= moment.time_s <= close[1]]
    rows = min(max(len(within), ROWS[0]), ROWS[1])
    for number, moment in enumerate(within):
        since = moment.time_s - begun.time_s
        text = moment.text if moment is begun else f"{moment.happening.value} +{since:.2f} s"
        axes.annotate(
            text, (moment.time_s, 1.0), xytext=(0, 3 + ROW_PT * (number % rows)), xycoords=axes.get_xaxis_transform(),
            textcoords="offset points", ha="left", va="bottom", fontsize=9, color=MOMENT[moment.happening.name],
        )  # fmt: skip
    return rows


def _keys(one: OneFlight) -> list[Any]:
    changed = _changed(one.true_gains)
    keys: list[Any] = [
        Line2D([], [], color=U_T, linewidth=2, label="u_s with the adaptation"),
        Line2D([], [], color=U_S, linestyle="--", label="u_s alone"),
        Line2D([], [], color=NEUTRAL, linestyle=":", label=f"{BACK_M:g} m"),
        Patch(color=MOMENT["NOTICED"], alpha=0.2, label="searching, with dither"),
        *(Line2D([], [], color=SERIES[i % len(SERIES)], linewidth=1.8, label=f"thruster {i + 1}") for i in changed),
        Line2D([], [], color=NEUTRAL, linewidth=0.9, label="other thrusters" if changed else "all thrusters"),
        Line2D([], [], color="black", linestyle="--", linewidth=0.9, label="true gain"),
    ]
    return keys
