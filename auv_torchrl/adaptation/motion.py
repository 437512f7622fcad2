"""One control step of the source vehicle with a given wrench, and how it depends on speed and wrench."""

from typing import Any, NamedTuple

import numpy as np

from auv_torchrl.physics import ActiveTerms, prepare
from auv_torchrl.physics.hydrodynamics import acceleration
from auv_torchrl.vehicle import CONTROLLED, CONTROLLED_INDEX, Vehicle

Array = Any
_D = len(CONTROLLED)
_SLOW = 1.0  # m/s, below which two Runge-Kutta steps per control step are within 2 mm/s of exact
_SUBSTEPS_SLOW, _SUBSTEPS = 2, 4
_SPEED_STEP = 1e-4  # m/s and rad/s, of the finite differences
_WRENCH_STEP = 1e-3  # of what the thrusters can give


class Step(NamedTuple):
    """What one control step does; arrays (N, ...), float64."""

    displacement: Array  # (4,) m and rad along the body axes
    velocity: Array  # (4,) m/s and rad/s at its end
    by_velocity: Array  # (8, 4) derivatives of both, stacked, by the velocity at its start
    by_wrench: Array  # (8, 4) by the wrench


class SourceMotion:
    """Level motion of the source vehicle in its four controlled degrees of freedom, on numpy.

    Attitude is taken as level: what roll and pitch do to a vehicle that is not held level counts as noise.

    Args:
        vehicle: one vehicle (empty batch), the source.
        control_dt: s.

    Raises:
        ValueError: for a batch of vehicles.
    """

    def __init__(self, vehicle: Vehicle, control_dt: float):
        if vehicle.batch_size:
            raise ValueError(f"motion: got vehicles of batch {tuple(vehicle.batch_size)}: give one source vehicle")
        self._coefficients = prepare(vehicle)
        self._terms = ActiveTerms.of(self._coefficients)
        self._controlled = list(CONTROLLED_INDEX)
        self.control_dt = control_dt
        per_share = (self._coefficients.allocation * self._coefficients.full_thrust)[self._controlled]
        self.per_share = per_share  # (4, n) wrench in N and N m per share of each thruster's full thrust
        self.full_wrench = np.abs(per_share).sum(-1)  # (4,)
        columns = np.zeros((1 + 2 * _D, 2, _D))
        columns[1 : 1 + _D, 0] = _SPEED_STEP * np.eye(_D)
        columns[1 + _D :, 1] = _WRENCH_STEP * np.diag(self.full_wrench)
        self._columns = columns
        self._step_sizes = np.concatenate((np.full(_D, _SPEED_STEP), _WRENCH_STEP * self.full_wrench))

    def __call__(self, velocity: Array, wrench: Array) -> Step:
        """Displacement, velocity (N, 4) and their derivatives for velocities (N, 4) and wrenches (N, 4)."""
        v = velocity[:, None] + self._columns[:, 0]
        moved, reached = self.advance(v, wrench[:, None] + self._columns[:, 1])
        both = np.concatenate((moved, reached), axis=-1)  # (N, 9, 8)
        slopes = ((both[:, 1:] - both[:, :1]) / self._step_sizes[:, None]).swapaxes(-1, -2)
        return Step(moved[:, 0], reached[:, 0], slopes[..., :_D], slopes[..., _D:])

    def advance(self, velocity: Array, wrench: Array) -> tuple[Array, Array]:
        """Displacement and velocity (..., 4) alone, without derivatives."""
        slow = bool((np.abs(velocity[..., :3]) < _SLOW).all())
        substeps = _SUBSTEPS_SLOW if slow else _SUBSTEPS
        h = self.control_dt / substeps
        force = self._six(wrench)
        level = np.broadcast_to(np.eye(3), (*velocity.shape[:-1], 3, 3))
        origin = np.zeros(3)

        def rate(v: Array) -> Array:
            return acceleration(self._coefficients, self._terms, level, origin, self._six(v), force)[
                ..., self._controlled
            ]

        moved = np.zeros_like(velocity)
        for _ in range(substeps):
            k1 = rate(velocity)
            v2 = velocity + h / 2 * k1
            k2 = rate(v2)
            v3 = velocity + h / 2 * k2
            k3 = rate(v3)
            v4 = velocity + h * k3
            moved = moved + h / 6 * (velocity + 2 * v2 + 2 * v3 + v4)
            velocity = velocity + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(v4))
        return moved, velocity

    def _six(self, controlled: Array) -> Array:
        full = np.zeros((*controlled.shape[:-1], 6))
        full[..., self._controlled] = controlled
        return full
