"""A motion that is known beforehand, as a table over time: where, which way, how fast."""

# pyright: standard
# (the stubs of numpy do not know what linspace and unwrap return)

from collections.abc import Callable
from typing import Any

import numpy as np
from array_api_compat import array_namespace

from auv_torchrl.physics.kinematics import quaternion_from_euler
from auv_torchrl.tasks.task import Reference

Array = Any
Floats = Any  # numpy, float64

GRID_S = 0.02  # s between rows of the table: at 1 m/s and 0.25 m of radius a straight line is 0.2 mm off the curve
GRID_M = 0.001  # m between points of a path, so that a start from rest is smooth too


class Curve:
    """Position, attitude and their rates over time, read off a table; open ones rest at their ends.

    Args:
        pose: (k, 6) m and rad at equal steps of time; angles without jumps.
        step: s.
        closed: whether the last row is the first one again, up to whole turns, and the motion goes on.
    """

    def __init__(self, pose: Floats, step: float, closed: bool):
        self.step, self.closed, self.duration = step, closed, step * (len(pose) - 1)
        if closed:
            lap = pose[-1] - pose[0]
            around = np.concatenate((pose[-2:-1] - lap, pose, pose[1:2] + lap))
            rate = (around[2:] - around[:-2]) / (2 * step)
        else:
            rate = np.gradient(pose, step, axis=0)
        self.rows = np.concatenate((pose, rate), axis=1)
        self._tables: dict[Any, Array] = {}  # the same in other array libraries

    @property
    def reach_m(self) -> float:
        """How far it goes from the origin along any axis."""
        return float(np.abs(self.rows[:, :3]).max())

    def at(self, time: Array) -> Reference:
        """Where it is at times (...) s; at rest at its ends before and after, where it is open."""
        xp = array_namespace(time)
        begun = xp.remainder(time, self.duration) if self.closed else xp.clip(time, 0.0, self.duration)
        place = begun / self.step
        last = len(self.rows) - 2
        low = xp.clip(xp.astype(xp.floor(place), xp.int64), 0, last)
        table = self._table(time)
        below = table[low]
        row = below + (place - xp.astype(low, place.dtype))[..., None] * (table[low + 1] - below)
        rate = row[..., 6:]
        if not self.closed:
            rate = xp.where(((time >= 0) & (time <= self.duration))[..., None], rate, 0.0)
        roll, pitch, yaw = row[..., 3], row[..., 4], row[..., 5]
        velocity = xp.concat((rate[..., :3], _turning(pitch, yaw, rate[..., 3:])), axis=-1)
        return Reference(row[..., :3], quaternion_from_euler(roll, pitch, yaw), velocity)

    def _table(self, time: Array) -> Array:
        key = (time.dtype, time.device)
        if key not in self._tables:
            xp = array_namespace(time)
            self._tables[key] = xp.asarray(self.rows, dtype=time.dtype, device=time.device)
        return self._tables[key]


def _turning(pitch: Array, yaw: Array, rate: Array) -> Array:
    """Angular velocity (..., 3) along the axes of the earth, of rates (..., 3) of ZYX Euler angles."""
    xp = array_namespace(yaw)
    level, c, s = xp.cos(pitch), xp.cos(yaw), xp.sin(yaw)
    p, q, r = rate[..., 0], rate[..., 1], rate[..., 2]
    return xp.stack((c * level * p - s * q, s * level * p + c * q, r - xp.sin(pitch) * p), axis=-1)


def flown(
    path: Floats, speed: Callable[[Floats, float], Floats], closed: bool, along: bool, tilt: tuple[float, float]
) -> Curve:
    """A path as a motion.

    Args:
        path: (k, 3) m, corners of a line; a closed one ends where it begins.
        speed: m/s by distances (n,) flown and the whole length, m; may be 0 at the ends.
        closed: whether it is flown again and again.
        along: whether the heading is that of the path; north if not.
        tilt: roll and pitch, rad.

    Raises:
        ValueError: for a path that goes nowhere.
    """
    path = np.asarray(path, dtype=float)
    corners = travelled(path)
    length = float(corners[-1])
    if not length > GRID_M:
        raise ValueError(f"the path is {length:g} m long: give one that goes somewhere")
    distance = np.linspace(0.0, length, max(3, round(length / GRID_M) + 1))
    pace = speed(distance, length)
    passed = np.concatenate(([0.0], np.cumsum(2 * np.diff(distance) / (pace[1:] + pace[:-1]))))
    steps = max(2, round(passed[-1] / GRID_S))
    where = np.interp(np.linspace(0.0, passed[-1], steps + 1), passed, distance)
    pose = np.zeros((steps + 1, 6))
    for axis in range(3):
        pose[:, axis] = np.interp(where, corners, path[:, axis])
    pose[:, 3:5] = tilt
    if along:
        pose[:, 5] = course(path, corners, where, closed)
    return Curve(pose, passed[-1] / steps, closed)


def travelled(path: Floats) -> Floats:
    """How far (k,) m along a line each of its corners (k, 3) is."""
    return np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))))


def course(path: Floats, corners: Floats, where: Floats, closed: bool) -> Floats:
    """Heading (n,) rad of a path (k, 3) at distances ``where`` (n,), without jumps; kept where it goes up or down."""
    leg, middle = np.diff(path, axis=0), (corners[1:] + corners[:-1]) / 2
    level = np.hypot(leg[:, 0], leg[:, 1]) > 1e-9
    if not level.any():
        return np.zeros(len(where))
    yaw, middle = np.unwrap(np.arctan2(leg[level, 1], leg[level, 0])), middle[level]
    if closed:
        lap = 2 * np.pi * np.round((yaw[-1] - yaw[0]) / (2 * np.pi))
        lap += np.unwrap([yaw[-1], yaw[0] + lap])[1] - (yaw[0] + lap)
        yaw = np.concatenate((yaw[-1:] - lap, yaw, yaw[:1] + lap))
        middle = np.concatenate((middle[-1:] - corners[-1], middle, middle[:1] + corners[-1]))
    return np.interp(where, middle, yaw)
