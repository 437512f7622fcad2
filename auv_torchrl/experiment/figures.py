"""The counterparts of the paper's figures 9, 10, 11 and 16."""

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from torch import Tensor

from auv_torchrl.evaluation import STEADY_FROM_S, steady_errors
from auv_torchrl.experiment.results import TABLE_2
from auv_torchrl.flight import Flight
from auv_torchrl.palette import CONTROLLER, LABEL, NEUTRAL
from auv_torchrl.physics import ActiveTerms, prepare
from auv_torchrl.physics.coefficients import allocation_matrix
from auv_torchrl.physics.pushes import wrench_per_share
from auv_torchrl.physics.thrusters import thrust_target
from auv_torchrl.quantities import counted
from auv_torchrl.vehicle import CONTROLLED, Vehicle, index_of
from auv_torchrl.vehicle.tensors import tensors

SHOWN = 12  # starts whose trajectory is drawn
REFERENCE_WIDTH = 4.0  # points, broad enough to be seen below the paths on it
FLOOR_M = 1e-4  # smallest error on a logarithmic axis
DPI = 150
_DASH: dict[str, Literal["-", "--", ":"]] = {"u_s": "--", "u_t": "-", "nominal": ":"}
_FORCE_UNIT = {"surge": "N", "sway": "N", "heave": "N", "roll": "N m", "pitch": "N m", "yaw": "N m"}

Flights = Mapping[str, Flight]


def save_figures(
    folder: Path,
    flights: Flights,
    vehicles: Mapping[str, Vehicle],
    scenario: str,
    axes: tuple[str, ...] = CONTROLLED,
    speed: float = 0.0,
) -> list[Path]:
    """Draw all figures of a run into ``folder`` and return their paths.

    Args:
        folder: of the run.
        flights: ``nominal``, ``u_s`` and ``u_t``, as far as they were flown, from the same starts.
        vehicles: the vehicle (no batch) that each of them flew.
        scenario: its name, for the titles and the paper's numbers.
        axes: that the policy commands.
        speed: ahead in m/s, at which fins and azimuth thrusters steer.
    """
    drawn = {
        "trajectories.png": trajectories(flights, scenario),
        "errors.png": errors(flights, scenario),
        "forces.png": forces(flights, vehicles, scenario, axes, speed),
        "distribution.png": distribution(flights, scenario),
    }
    for name, figure in drawn.items():
        figure.savefig(folder / name, dpi=DPI)
    return [folder / name for name in drawn]


def _figure(width: float, height: float, title: str) -> Figure:
    figure = Figure(figsize=(width, height), layout="constrained")
    figure.suptitle(title, fontsize=12)
    return figure


def bare(axes: Axes) -> None:
    """No frame, a faint grid, and 0.01 instead of 10^-2 on logarithmic axes."""
    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() == "log":
            axis.set_major_formatter("{x:g}")
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.25, linewidth=0.6)


def trajectories(flights: Flights, scenario: str) -> Figure:
    """Figure 9: where the vehicle went under u_s and u_t, from above and from the side."""
    figure = _figure(10, 5, f"Trajectories of the first {SHOWN} starts, {scenario}")
    above, side = figure.subplots(1, 2)
    for axes, (across, up) in ((above, (1, 0)), (side, (0, 2))):
        for name in _painted(flights):
            position = flights[name].position[:SHOWN].double().numpy()
            for path in position:
                axes.plot(path[:, across], path[:, up], _DASH[name], color=CONTROLLER[name], linewidth=1.0, alpha=0.8)
        starts = next(iter(flights.values())).position[:SHOWN, 0].double().numpy()
        axes.plot(starts[:, across], starts[:, up], "o", color="black", markersize=4)
        draw_reference(axes, next(iter(flights.values())).of_start(0), across, up)
        axes.set_aspect("equal", adjustable="datalim")
        bare(axes)
    above.set(title="from above", xlabel="east in m", ylabel="north in m")
    side.set(title="from the side", xlabel="north in m", ylabel="down in m")
    side.invert_yaxis()
    marks = [Line2D([], [], marker="o", linestyle="", color="black", label="start"), reference_key(flights)]
    figure.legend(handles=[*_keys(flights), *marks], loc="outside lower center", ncols=5, frameon=False)
    return figure


def draw_reference(axes: Axes, flight: Flight, across: int, up: int) -> None:
    """Where the vehicle of one flight (T + 1) should have been: a cross, or the path of a reference that moves."""
    path = flight.reference_position.double().numpy()
    if flight.moving:
        axes.plot(path[:, across], path[:, up], color="black", linewidth=REFERENCE_WIDTH, alpha=0.25, zorder=0.5)
    else:
        axes.plot(path[0, across], path[0, up], "+", color="black", markersize=14, markeredgewidth=2)


def reference_key(flights: Flights) -> Line2D:
    """What the legend says of it."""
    if any(flight.moving for flight in flights.values()):
        return Line2D([], [], color="black", linewidth=REFERENCE_WIDTH, alpha=0.25, label="reference")
    return Line2D([], [], marker="+", linestyle="", color="black", markersize=10, label="target")


def aim(flight: Flight) -> str:
    """What the distances of a flight are to."""
    return "reference" if flight.moving else "target"


def errors(flights: Flights, scenario: str) -> Figure:
    """Figure 10: position error over time, median, middle 90 % and worst start."""
    figure = _figure(
        8, 4.5, f"Position error over {counted(next(iter(flights.values())).shape[0], 'start')}, {scenario}"
    )
    axes = figure.subplots()
    for name in _painted(flights):
        flight = flights[name]
        time = flight.time[0].double().numpy()
        error = flight.position_error.double().clamp(FLOOR_M, 1e6).numpy()
        low, middle, high = np.quantile(error, (0.05, 0.5, 0.95), axis=0, method="nearest")
        axes.fill_between(time, low, high, color=CONTROLLER[name], alpha=0.18, linewidth=0)
        axes.plot(time, middle, _DASH[name], color=CONTROLLER[name], linewidth=2)
        axes.plot(time, error.max(axis=0), _DASH[name], color=CONTROLLER[name], linewidth=0.8)
    flight = next(iter(flights.values()))
    end = float(flight.time[0, -1])
    axes.axvspan(STEADY_FROM_S, end, color=NEUTRAL, alpha=0.08, linewidth=0)
    axes.text(STEADY_FROM_S + 0.1, 0.02, "averaged in the table", transform=axes.get_xaxis_transform(), fontsize=9)
    axes.set(yscale="log", xlabel="time in s", ylabel=f"distance to the {aim(flight)} in m", xlim=(0, end))
    bare(axes)
    note = "thick: median, band: 5 to 95 % of the starts, thin: worst"
    figure.legend(handles=_keys(flights), loc="outside lower center", ncols=3, frameon=False, title=note)
    return figure


def forces(
    flights: Flights,
    vehicles: Mapping[str, Vehicle],
    scenario: str,
    controlled: tuple[str, ...] = CONTROLLED,
    speed: float = 0.0,
) -> Figure:
    """Figure 11: what the thrusters were asked for and what the changed vehicle adds to it, for the first start."""
    columns = [name for name in ("u_s", "u_t") if name in flights] or ["nominal"]
    figure = _figure(
        5.2 * len(columns), 2.0 * len(controlled), f"Control force and disturbance, first start, {scenario}"
    )
    grid = figure.subplots(len(controlled), len(columns), sharex=True, sharey="row", squeeze=False)
    for column, name in enumerate(columns):
        flight = flights[name].of_start(0)
        asked, given = control_forces(flight, vehicles["nominal"], vehicles[name], controlled, speed)
        time = flight.time.double().numpy()
        for row, channel in enumerate(controlled):
            axes = grid[row, column]
            axes.plot(time, asked[:, row], color=CONTROLLER[name], linewidth=1.2)
            axes.plot(time, (given - asked)[:, row], color="black", linewidth=1.0, linestyle="--")
            bare(axes)
            if column == 0:
                axes.set_ylabel(f"{channel} in {_FORCE_UNIT[channel]}")
        grid[0, column].set_title(LABEL[name], fontsize=11)
        grid[-1, column].set_xlabel("time in s")
    keys = [Line2D([], [], color=CONTROLLER[name], label=f"{name}: force of these commands on the nominal vehicle")
            for name in columns]  # fmt: skip
    keys.append(Line2D([], [], color="black", linestyle="--", label="disturbance: force really given less that"))
    figure.legend(handles=keys, loc="outside lower center", ncols=1, frameon=False)
    return figure


def control_forces(
    flight: Flight,
    nominal: Vehicle,
    flown: Vehicle,
    controlled: tuple[str, ...] = CONTROLLED,
    speed: float = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Forces in N and moments in N m along the controlled axes, both (T + 1, a), of one start.

    Returns:
        What the thruster commands give on the nominal vehicle, at rest or with servos at the speed, and what the
        thrusters of the flown vehicle gave; they differ by the disturbance that the changed actuation is.
    """

    def in_channels(vehicle: Vehicle, thrust: Tensor) -> np.ndarray:
        sound = tensors(vehicle)
        each = allocation_matrix(sound).to(thrust)
        if vehicle.servos:
            whole = prepare(sound.replace(gain=torch.ones_like(sound.gain)))
            each = wrench_per_share(whole, ActiveTerms.of(whole), speed).to(thrust) / whole.full_thrust
        wrench = thrust @ each.T
        return wrench[:, index_of(controlled)].numpy()

    intact = prepare(tensors(nominal))
    asked = thrust_target(intact, ActiveTerms.of(intact), flight.command.to(intact.limit))
    return in_channels(nominal, asked), in_channels(flown, flight.thrust.to(torch.float64))


def distribution(flights: Flights, scenario: str) -> Figure:
    """Figure 16: mean error of each start for t >= 10 s, beside the paper's means where it has them."""
    figure = _figure(8, 1.2 + 1.0 * len(flights), f"Mean error of each start for t ≥ {STEADY_FROM_S:g} s, {scenario}")
    axes = figure.subplots()
    names = _painted(flights)
    spread = np.random.default_rng(0)
    published = TABLE_2.get(scenario, {})
    for row, name in enumerate(names):
        values = steady_errors(flights[name]).clamp(FLOOR_M, 1e6).numpy()
        height = row + spread.uniform(-0.18, 0.18, len(values))
        axes.plot(values, height, "o", color=CONTROLLER[name], markersize=3.5, alpha=0.5, markeredgewidth=0)
        mean = values.mean()
        axes.plot([mean, mean], [row - 0.32, row + 0.32], color=CONTROLLER[name], linewidth=2.5)
        axes.text(
            mean, row + 0.36, f"{mean:.2g} m" if mean < 0.1 else f"{mean:.2f} m", ha="center", va="bottom", fontsize=9
        )
        if name in published:
            axes.plot(published[name], row, "D", color="black", markersize=6, markerfacecolor="none")
    axes.set(
        xscale="log", yticks=range(len(names)), yticklabels=[LABEL[name] for name in names],
        xlabel=f"mean distance to the {aim(flights[names[0]])} in m", ylim=(-0.6, len(names) - 0.2),
    )  # fmt: skip
    bare(axes)
    keys = [
        Line2D([], [], marker="o", linestyle="", color=NEUTRAL, markersize=4, label="a start"),
        Line2D([], [], marker="|", linestyle="", color=NEUTRAL, markersize=12, markeredgewidth=2.5, label="mean"),
    ]
    if published:
        diamond = Line2D([], [], marker="D", linestyle="", color="black", markerfacecolor="none", label="paper's mean")
        keys.append(diamond)
    figure.legend(handles=keys, loc="outside lower center", ncols=3, frameon=False)
    return figure


def _painted(flights: Flights) -> list[str]:
    """In the order of painting: what matters most comes last."""
    return [name for name in ("nominal", "u_s", "u_t") if name in flights]


def _keys(flights: Flights) -> list[Line2D]:
    return [
        Line2D([], [], color=CONTROLLER[name], linestyle=_DASH[name], label=LABEL[name]) for name in _painted(flights)
    ]
