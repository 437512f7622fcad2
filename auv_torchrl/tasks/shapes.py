"""Paths as corners of a line, (k, 3) in m: rounded polygons and smooth curves."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

Floats = Any  # numpy, float64

_ARC = math.radians(2.0)  # between points of an arc: off by 0.02 % of its radius
_SMOOTH = 2000  # points of a smooth curve per lap


def rounded(corners: Sequence[Sequence[float]], radius: float, closed: bool) -> Floats:
    """A line through corners (k, 3), each cut by an arc of ``radius`` m, or of less where legs are too short for it.

    A closed one begins and ends in the middle of its first leg.
    """
    points = np.asarray(corners, dtype=float)
    if closed:
        begin = (points[0] + points[1]) / 2
        points = np.concatenate(([begin], points[1:], points[:1], [begin]))
    parts = [points[:1]]
    for before, corner, after in zip(points[:-2], points[1:-1], points[2:], strict=True):
        parts.append(_arc(before, corner, after, radius))
    return np.concatenate((*parts, points[-1:]))


def _arc(before: Floats, corner: Floats, after: Floats, radius: float) -> Floats:
    come, go = corner - before, after - corner
    lengths = float(np.linalg.norm(come)), float(np.linalg.norm(go))
    come, go = come / lengths[0], go / lengths[1]
    turn = math.acos(float(np.clip(come @ go, -1.0, 1.0)))
    if radius == 0.0 or turn < 1e-6 or turn > math.pi - 1e-3:  # straight on, or back the way it came
        return corner[None]
    cut = min(radius * math.tan(turn / 2), min(lengths) / 2)
    radius = cut / math.tan(turn / 2)
    inwards = (go - math.cos(turn) * come) / math.sin(turn)  # across the way it comes, towards the centre
    angle = np.linspace(0.0, turn, max(2, math.ceil(turn / _ARC)))[:, None]
    return corner - cut * come + radius * (np.sin(angle) * come + (1 - np.cos(angle)) * inwards)


def parallel_lanes(length: float, spacing: float, count: int) -> list[tuple[float, float, float]]:
    """Corners of parallel lanes, north and south in turn, each further east."""
    ends = (0.0, length)
    return [(ends[(lane + end) % 2], lane * spacing, 0.0) for lane in range(count) for end in range(2)]


def lemniscate(length: float, width: float) -> Floats:
    """Gerono's: a figure of eight that lies along north, from its middle."""
    angle = np.linspace(0.0, 2 * np.pi, 2 * _SMOOTH + 1)
    return np.stack((length / 2 * np.sin(angle), width / 2 * np.sin(2 * angle), 0.0 * angle), axis=1)


def helix(radius: float, descent: float, turns: float) -> Floats:
    """Around the origin, clockwise from above, from north of it; ``descent`` m deeper with every turn."""
    angle = np.linspace(0.0, 2 * np.pi * turns, math.ceil(_SMOOTH * turns) + 1)
    return np.stack((radius * np.cos(angle), radius * np.sin(angle), descent * angle / (2 * np.pi)), axis=1)
