"""The vehicle from above and from behind, out of its thruster geometry, with what is at fault marked."""

from collections.abc import Collection

import numpy as np
from markupsafe import Markup

from auv_torchrl.diagnosis.report.svg import arrow, circle, line, polyline, rect, svg, text
from auv_torchrl.flightlog.log import Floats
from auv_torchrl.vehicle import Vehicle

_SIZE = 300.0
_HULL_M = 0.05  # the hull ends this far outside the thrusters
_FORCE_PX = 34.0


def from_above(vehicle: Vehicle, thrusters: Collection[int], axes: Collection[str]) -> Markup:
    """Bow up, starboard right; ``thrusters`` (from 1) and ``axes`` (surge, sway, yaw, ...) are marked."""
    position, direction = _geometry(vehicle)
    scale = _scale(position)
    half = scale * (np.abs(position[:, :2]).max(axis=0) + _HULL_M)
    middle, height = _SIZE / 2, 2 * half[0] + 64
    centre = height / 2
    bow = centre - half[0]
    parts = [
        rect(middle - half[1], bow, 2 * half[1], 2 * half[0], "hull", 14),
        polyline([middle - 16, middle, middle + 16], [bow + 20, bow + 6, bow + 20], "bow"),
        text(middle, bow - 8, "bow", "tick", "middle"),
        *_axes_from_above(middle, centre, axes),
    ]
    for i, (where, force) in enumerate(zip(position, direction, strict=True)):
        x, y = middle + scale * where[1], centre - scale * where[0]
        css = "thruster bad" if i + 1 in thrusters else "thruster"
        horizontal = np.linalg.norm(force[:2]) > 0.5
        if horizontal:
            parts.append(arrow(x, y, x + _FORCE_PX * force[1], y - _FORCE_PX * force[0], f"{css} force"))
        parts.append(circle(x, y, 13, css))
        if not horizontal:
            parts.append(circle(x, y, 10, f"{css} ring"))
        parts.append(text(x, y + 4.5, str(i + 1), f"{css} number", "middle"))
    return svg(_SIZE, height, _label("from above", thrusters, axes), parts, "vehicle")


def from_behind(vehicle: Vehicle, thrusters: Collection[int], axes: Collection[str]) -> Markup:
    """Starboard right, down down: the vertical thrusters with the force of a positive command."""
    position, direction = _geometry(vehicle)
    vertical = np.flatnonzero(np.abs(direction[:, 2]) > 0.5)
    scale = _scale(position)
    middle, height = _SIZE / 2, 138.0
    half = scale * (np.abs(position[:, 1]).max() + _HULL_M)
    parts = [
        rect(middle - half, 42, 2 * half, 62, "hull", 12),
        line(8, 22, _SIZE - 8, 22, "surface"),
        text(12, 17, "surface", "tick"),
    ]
    if "heave" in axes:
        parts.append(arrow(middle, 50, middle, 98, "axis bad", 11))
        parts.append(text(middle + 10, 78, "heave", "axis bad label"))
    columns: dict[float, list[int]] = {}
    for i in vertical:
        columns.setdefault(round(float(position[i, 1]), 3), []).append(int(i))
    for across, members in columns.items():
        x = middle + scale * across
        bad = any(i + 1 in thrusters for i in members)
        css = "thruster bad" if bad else "thruster"
        down = 1.0 if direction[members[0], 2] > 0 else -1.0
        parts.append(arrow(x, 73, x, 73 + 46 * down, f"{css} force"))
        parts.append(rect(x - 10 * len(members) - 4, 61, 20 * len(members) + 8, 24, css, 12))
        parts.append(text(x, 77.5, " ".join(str(i + 1) for i in members), f"{css} number", "middle"))
    return svg(_SIZE, height, _label("from behind", thrusters, axes), parts, "vehicle")


def _axes_from_above(middle: float, centre: float, axes: Collection[str]) -> list[str]:
    parts = []
    if "surge" in axes:
        parts += [arrow(middle, centre + 40, middle, centre - 48, "axis bad", 11)]
        parts += [text(middle + 9, centre - 32, "surge", "axis bad label")]
    if "sway" in axes:
        parts += [arrow(middle - 44, centre, middle + 48, centre, "axis bad", 11)]
        parts += [text(middle + 52, centre - 6, "sway", "axis bad label")]
    if "yaw" in axes:
        angle = np.linspace(-2.4, 1.2, 30)
        xs, ys = middle + 30 * np.cos(angle), centre + 30 * np.sin(angle)
        parts += [polyline(xs[:-1].tolist(), ys[:-1].tolist(), "axis bad")]
        parts += [arrow(float(xs[-3]), float(ys[-3]), float(xs[-1]), float(ys[-1]), "axis bad", 11)]
        parts += [text(middle, centre + 52, "yaw", "axis bad label", "middle")]
    return parts


def _geometry(vehicle: Vehicle) -> tuple[Floats, Floats]:
    return vehicle.thruster_position, vehicle.thruster_direction


def _scale(position: Floats) -> float:
    """Pixels per metre at which the hull fills the width."""
    return (_SIZE / 2 - 22) / (float(np.abs(position[:, 1]).max()) + _HULL_M)


def _label(view: str, thrusters: Collection[int], axes: Collection[str]) -> str:
    marked = [f"thruster {i}" for i in sorted(thrusters)] + sorted(axes)
    return f"the vehicle {view}, marked: {', '.join(marked) or 'nothing'}"
