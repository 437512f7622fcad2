"""From the motion that sensors report to the true one of a vehicle, and back.

Starts of windows are as reported, so that vehicles with other sensors begin where the same samples say that they do: a
vehicle whose compass is off by half a turn begins there turned round, one whose lengths are doubled at half the place
and half the speed. What a sensor does is found by reading it, so that a new one needs no line here.

A reported velocity is what reported positions change by, along the axes of the reported attitude. Where the log holds
no x and y it is what velocities say, along the axes of the body; of an instrument that is turned or sits off the
origin, along its own axes at its own place.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from auv_torchrl.physics.coefficients import Coefficients
from auv_torchrl.physics.kinematics import (
    conjugate,
    cross,
    least_turn,
    matvec,
    quaternion_from_euler,
    quaternion_product,
    rotation_matrix,
)
from auv_torchrl.sensors.instruments import read
from auv_torchrl.sensors.report import motion_of
from auv_torchrl.sensors.sensor import MOTION

Floats = np.ndarray[Any, np.dtype[Any]]
YAW = MOTION.index("yaw")
STEP = 1e-6  # m, rad, m/s, rad/s, of differences


@dataclass(frozen=True)
class Mixing:
    """What is reported of linear velocities, where some of the vehicles (R,) report them mixed."""

    rows: Floats  # (R, 3, 6) reported u, v, w per unit of each true number of the velocity

    @staticmethod
    def of(slopes: Floats, speed: Floats, channels: tuple[str, ...]) -> "Mixing | None":
        """Of ``slopes`` (R, 12, 12) of reports, in logs of some channels; None where no vehicle mixes any.

        An axis whose place is logged, or that is not logged, has the true ``speed`` (R, 3) over the reported one. One
        that is not logged, but mixed with one that is, is what the instrument would have reported of it.
        """
        own = slopes[:, 6:9, 6:]
        velocity, place = (np.array([name in channels for name in names]) for names in (MOTION[6:9], MOTION[:3]))
        mixed = linked(slopes)
        taken = (velocity & ~place) | (mixed & (mixed & velocity).any(1, keepdims=True))
        rows = np.where(taken[..., None], own, np.eye(3, 6) / speed[:, :, None])
        return Mixing(rows) if _beside_diagonal(rows).any() else None

    def reported(self, linear: Floats, angular: Floats, unmixed: Floats) -> Floats:
        """Reports (..., 3) of velocities, or of accelerations; ``unmixed`` of the vehicles that do not mix them."""
        mixed = matvec(self.rows[..., :3], linear) + matvec(self.rows[..., 3:], angular)
        return np.where(self._mixes, mixed, unmixed)

    def true(self, linear: Floats, angular: Floats, unmixed: Floats) -> Floats:
        """The inverse of :meth:`reported` at the same turning of the body."""
        mixed = matvec(np.linalg.inv(self.rows[..., :3]), linear - matvec(self.rows[..., 3:], angular))
        return np.where(self._mixes, mixed, unmixed)

    @property
    def _mixes(self) -> np.ndarray:
        return np.asarray(_beside_diagonal(self.rows).any((-2, -1)))[..., None]


def linked(slopes: Floats) -> np.ndarray:
    """Whether reports of each linear velocity have some of others in them, (R, 3), of ``slopes`` (R, 12, 12)."""
    beside = _beside_diagonal(slopes[:, 6:9, 6:])[..., :3]
    return np.asarray(beside.any(1) | beside.any(2))


def _beside_diagonal(rows: Floats) -> np.ndarray:
    """Where numbers (..., 3, 6) beside the diagonal are not 0."""
    return np.asarray((rows != 0) & ~np.eye(3, 6, dtype=bool))


@dataclass(frozen=True)
class Inverse:
    """How vehicles (R,) move where the same is reported of them, in logs that hold some channels."""

    gain: Floats  # (R, 12) what is reported of each number of a motion, over what is true; 1 where others are mixed in
    slopes: Floats  # (R, 12, 12) what is reported of a motion, rows, per unit of each of its true numbers, columns
    offset: Floats  # (R, 12) what is reported of a vehicle at the origin that looks north
    speed: Floats  # (R, 3) true linear velocities over reported ones, in the earth frame, or the body's without x and y
    turn: Floats  # (R, 4) quaternion from the reported to the true heading
    by_position: bool  # whether a velocity is what positions change by
    mixing: Mixing | None  # of what is reported of velocities, where an instrument mixes them

    @staticmethod
    def of(c: Coefficients, channels: tuple[str, ...]) -> "Inverse":
        """Read the sensors of vehicles (R,) at the origin, and a unit away from it in each number."""
        probes = np.concatenate([np.zeros((1, 12)), np.eye(12)])
        reports = read(c.rows((slice(None), None)), MOTION, np.broadcast_to(probes, (len(c.mass_matrix), 13, 12)))
        offset = reports[:, 0]
        slopes = (reports[:, 1:] - offset[:, None]).swapaxes(1, 2)
        gain = np.einsum("rii->ri", slopes).copy()
        gain[:, 6:9][linked(slopes)] = 1.0
        speed = np.ones((len(gain), 3))
        for axis, (place, velocity) in enumerate(zip(MOTION[:3], MOTION[6:9], strict=True)):
            if place in channels or velocity in channels:
                speed[:, axis] = 1.0 / gain[:, MOTION.index(place if place in channels else velocity)]
        zero = np.zeros_like(offset[:, YAW])
        turn = quaternion_from_euler(zero, zero, -offset[:, YAW])
        by_position = {"x", "y"} <= set(channels)
        return Inverse(gain, slopes, offset, speed, turn, by_position, Mixing.of(slopes, speed, channels))

    @property
    def is_true(self) -> bool:
        """Whether all vehicles move as reported, but for a shift of where they are."""
        placed = self.by_position or self.mixing is None
        return placed and bool((self.offset[..., 3:6] == 0).all() and (self.speed == 1).all())

    def kinds(self) -> tuple[np.ndarray, np.ndarray]:
        """Numbers of vehicles whose sensors do what those of most do, and of the others."""
        mixed = [] if self.by_position or self.mixing is None else [self.mixing.rows.reshape(len(self.gain), -1)]
        numbers = np.concatenate([self.gain, self.offset, self.speed, *mixed], axis=1)
        kinds = [row.tobytes() for row in numbers]
        most = Counter(kinds).most_common(1)[0][0]
        common = np.array([kind == most for kind in kinds])
        return np.flatnonzero(common), np.flatnonzero(~common)

    def shared(self) -> "Inverse":
        """One row for all where all vehicles have the same sensors."""
        fields = (self.slopes, self.offset, self.speed, self.turn)
        return _each(self, lambda field: field[:1]) if all((field == field[:1]).all() for field in fields) else self

    def by_step(self) -> "Inverse":
        """The same for vehicles (R, 1), so that steps are a batch axis."""
        return _each(self, lambda field: field[:, None])

    def true_state(self, reported: Floats) -> Floats:
        """True states (..., 13) of reported ones (..., 13): position, quaternion, velocity."""
        position = (reported[..., :3] - self.offset[..., :3]) / self.gain[..., :3]
        if self.is_true:
            return _joined(position, reported[..., 3:])
        quaternion = quaternion_product(self.turn, reported[..., 3:7])
        linear = self._true_linear(reported[..., 3:7], reported[..., 7:10], reported[..., 10:])
        return _joined(position, quaternion, linear, reported[..., 10:])

    def reported_state(self, states: Floats) -> Floats:
        """The inverse of :meth:`true_state`."""
        position = states[..., :3] * self.gain[..., :3] + self.offset[..., :3]
        if self.is_true:
            return _joined(position, states[..., 3:])
        quaternion = quaternion_product(conjugate(self.turn), states[..., 3:7])
        linear = self._reported_linear(quaternion, states[..., 7:10])
        if self.mixing is not None and not self.by_position:
            linear = self.mixing.reported(states[..., 7:10], states[..., 10:], linear)
        return _joined(position, quaternion, linear, states[..., 10:])

    def true_start(self, start: Floats) -> Floats:
        """True states (..., 13) of reported starts (..., 12): position, angles, velocity."""
        quaternion = quaternion_from_euler(start[..., 3], start[..., 4], start[..., 5])
        return self.true_state(np.concatenate([start[..., :3], quaternion, start[..., 6:]], axis=-1))

    def reported_start(self, states: Floats) -> Floats:
        """The inverse of :meth:`true_start`."""
        return motion_of(self.reported_state(states))

    def as_reported(self, motion: Floats) -> Floats:
        """Reported motions (..., 12) whose velocities are not yet what positions change by, but what was measured."""
        if self.mixing is None or not self.by_position:
            return motion
        quaternion = quaternion_from_euler(motion[..., 3], motion[..., 4], motion[..., 5])
        true = self.mixing.true(motion[..., 6:9], motion[..., 9:], motion[..., 6:9])
        return _joined(motion[..., :6], self._reported_linear(quaternion, true), motion[..., 9:])

    def start_slopes(self, start: Floats, entries: np.ndarray) -> Floats:
        """What the true start moves by (W, n, n) per unit of each of ``n`` entries of reported starts (W, 12)."""
        moved = start[:, None] + STEP * np.eye(12)[entries]
        change = motion_of(self.true_start(moved)) - motion_of(self.true_start(start[:, None]))
        change[..., 3:6] = least_turn(change[..., 3:6])
        return change[..., entries].swapaxes(1, 2) / STEP

    def reported_rate(self, rate: Floats, true: Floats, reported: Floats) -> Floats:
        """Accelerations (..., 6) that sensors report, of true ones, at true and reported states (..., 13).

        States that vehicles share have one row.
        """
        if self.is_true:
            return rate
        inertial = rate[..., :3] + cross(*np.broadcast_arrays(true[..., 10:], true[..., 7:10]))
        linear = self._reported_linear(reported[..., 3:7], inertial)
        turning = cross(*np.broadcast_arrays(reported[..., 10:], reported[..., 7:10]))
        linear = linear - turning
        if self.mixing is not None and not self.by_position:
            linear = self.mixing.reported(rate[..., :3], rate[..., 3:], linear)
        return _joined(linear, rate[..., 3:])

    def true_rate(self, change: Floats, reported: Floats) -> Floats:
        """Changes of true accelerations (..., 6) along a motion, of reported ones at reported states (..., 13)."""
        if self.is_true:
            return change
        return _joined(self._true_linear(reported[..., 3:7], change[..., :3], change[..., 3:]), change[..., 3:])

    def _true_linear(self, attitude: Floats, linear: Floats, angular: Floats) -> Floats:
        """Vectors (..., 3) along the true axes of the body, of vectors along the axes of a reported attitude.

        ``angular`` is what goes with them: how the body turns, or how that changes.
        """
        if not self.by_position:
            unmixed = self.speed * linear
            return unmixed if self.mixing is None else self.mixing.true(linear, angular, unmixed)
        rotation = rotation_matrix(attitude)
        earth = self.speed * matvec(rotation, linear)
        return matvec(rotation.mT, matvec(rotation_matrix(self.turn).mT, earth) if _turns(self.turn) else earth)

    def _reported_linear(self, attitude: Floats, linear: Floats) -> Floats:
        """The inverse of :meth:`_true_linear`, where nothing is mixed."""
        if not self.by_position:
            return linear / self.speed
        rotation = rotation_matrix(attitude)
        earth = matvec(rotation, linear)
        earth = (matvec(rotation_matrix(self.turn), earth) if _turns(self.turn) else earth) / self.speed
        return matvec(rotation.mT, earth)


def _turns(turn: Floats) -> bool:
    """Whether some vehicle has another heading than reported, by quaternions (..., 4) of the turn."""
    return bool((turn[..., 1:] != 0).any())


def _each(sensors: Inverse, change: Callable[[Floats], Floats]) -> Inverse:
    """The same of the fields that ``change`` makes of those of ``sensors``."""
    return replace(
        sensors,
        **{name: change(getattr(sensors, name)) for name in ("gain", "slopes", "offset", "speed", "turn")},
        mixing=sensors.mixing and Mixing(change(sensors.mixing.rows)),
    )


def _joined(*parts: Floats) -> Floats:
    """Parts side by side in the last axis, the others broadcast."""
    batch = np.broadcast_shapes(*(part.shape[:-1] for part in parts))
    return np.concatenate([np.broadcast_to(part, (*batch, part.shape[-1])) for part in parts], axis=-1)
