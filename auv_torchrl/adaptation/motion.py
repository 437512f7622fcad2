"""One control step of the source vehicle with a given wrench, and how it depends on speed and wrench."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from auv_torchrl.adaptation.config import AdaptationConfig
from auv_torchrl.physics import ActiveTerms, prepare
from auv_torchrl.physics.fins import fin_forces, fin_wrench
from auv_torchrl.physics.hydrodynamics import acceleration
from auv_torchrl.physics.kinematics import matvec, normalise, quaternion_product, rotation_matrix
from auv_torchrl.physics.pushes import thrust_turned, wrench_per_share
from auv_torchrl.physics.thrusters import shares_turned
from auv_torchrl.tasks import Task, cruise_speed
from auv_torchrl.vehicle import CONTROLLED, DEGREES_OF_FREEDOM, Vehicle, index_of

Array = Any
_SLOW = 1.0  # m/s, below which two Runge-Kutta steps per control step are within 2 mm/s of exact
_SUBSTEPS_SLOW, _SUBSTEPS = 2, 4
_SPEED_STEP = 1e-4  # m/s and rad/s, of the finite differences
_WRENCH_STEP = 1e-3  # of what the thrusters can give
_FASTEST = {True: 3.0, False: 10.0}  # m/s, rad/s; beyond, the integration of the drag becomes unstable
_SLIGHT = 0.01  # share of a deflection that gives the slope of the lift
_STRONGEST = 4.0  # times what a fin does at the speed: at twice that


class Step(NamedTuple):
    """What one control step does in D degrees of freedom; arrays (N, ...), float64."""

    displacement: Array  # (D,) m and rad along the body axes
    velocity: Array  # (D,) m/s and rad/s at its end
    by_velocity: Array  # (2 D, D) derivatives of both, stacked, by the velocity at its start
    by_wrench: Array  # (2 D, D) by the wrench


class SourceMotion:
    """Motion of the source vehicle, on numpy: of one that hovers in its four controlled degrees of freedom, level.

    What roll and pitch do to a vehicle that is not held level counts as noise. A vehicle at speed is followed in all
    six, from the attitude that is measured: it steers by what its axes do to the others. Fins push by the flow at their
    places, azimuth thrusters aside with their thrust, and both turn as fast as their servos.

    Args:
        vehicle: one vehicle (empty batch), the source.
        control_dt: s.
        axes: degrees of freedom that are controlled.
        speed: ahead in m/s, at which they are; 0 of a vehicle that hovers.

    Raises:
        ValueError: for a batch of vehicles.
    """

    def __init__(self, vehicle: Vehicle, control_dt: float, axes: Sequence[str] = CONTROLLED, speed: float = 0.0):
        if vehicle.batch_size:
            raise ValueError(f"motion: got vehicles of batch {tuple(vehicle.batch_size)}: give one source vehicle")
        self._coefficients = c = prepare(vehicle)
        self._terms = ActiveTerms.of(c)
        self.control_dt, self.speed, self.axes = control_dt, speed, tuple(axes)
        self.followed = followed_axes(self.axes, speed)
        self.degrees = index_of(self.followed)  # D of them
        self.controlled = np.array([self.followed.index(axis) for axis in self.axes])  # places of the axes among them
        self.linear = np.array([degree < 3 for degree in self.degrees])  # (D,) bool: m/s, not rad/s
        self.velocity_rows = [7 + degree for degree in self.degrees]  # in a state: position, quaternion, velocity
        self.fastest = np.where(self.linear, _FASTEST[True], _FASTEST[False])
        per_share = wrench_per_share(c, self._terms, speed)[self.degrees]
        self.per_share = per_share  # (D, n) wrench in N and N m per share of each thruster's full thrust, at the speed
        self.full_wrench = self._units(np.abs(per_share).sum(-1))  # (D,)
        self.fins, self.servos = (
            np.isin(np.arange(vehicle.thrusters), rows) for rows in (vehicle.fins, vehicle.servos)
        )
        self._turned = thrust_turned(c, self._terms, np.asarray(speed)) if self._terms.azimuth else None
        ahead, middle = np.array([[speed, 0.0, 0.0, 0.0, 0.0, 0.0]]), np.zeros((1, vehicle.thrusters))
        self._slope = np.where(self.fins, self._fin_push(ahead, middle)[0], 1.0)  # (n,) N per share, at the speed
        size = self.size
        columns = np.zeros((1 + 2 * size, 2, size))
        columns[1 : 1 + size, 0] = _SPEED_STEP * np.eye(size)
        columns[1 + size :, 1] = _WRENCH_STEP * np.diag(self.full_wrench)
        self._columns = columns
        self._step_sizes = np.concatenate((np.full(size, _SPEED_STEP), _WRENCH_STEP * self.full_wrench))

    @property
    def size(self) -> int:
        """Number of degrees of freedom D."""
        return len(self.degrees)

    @property
    def is_level(self) -> bool:
        """Whether the vehicle is taken to stay level, as one that hovers."""
        return self.speed == 0.0

    def _units(self, full: Array) -> Array:
        """Where nothing pushes, the largest push along or about any other axis stands for what is much."""
        most = np.where(self.linear, full[self.linear].max(), full[~self.linear].max())
        return np.where(full > 0, full, most)

    def __call__(self, velocity: Array, wrench: Array, body: Array | None = None) -> Step:
        """Displacement, velocity (N, D) and their derivatives for velocities (N, D) and wrenches (N, D).

        ``body`` (N, 7) is position and quaternion at the start of the step, of a vehicle that is not level.
        """
        v = velocity[:, None] + self._columns[:, 0]
        body = None if body is None else body[:, None]
        moved, reached = self.advance(v, wrench[:, None] + self._columns[:, 1], body)
        both = np.concatenate((moved, reached), axis=-1)  # (N, 1 + 2 D, 2 D)
        slopes = ((both[:, 1:] - both[:, :1]) / self._step_sizes[:, None]).swapaxes(-1, -2)
        return Step(moved[:, 0], reached[:, 0], slopes[..., : self.size], slopes[..., self.size :])

    def advance(self, velocity: Array, wrench: Array, body: Array | None = None) -> tuple[Array, Array]:
        """Displacement and velocity (..., D) alone, without derivatives."""
        slow = bool((np.abs(velocity[..., self.linear]) < _SLOW).all())
        substeps = _SUBSTEPS_SLOW if slow else _SUBSTEPS
        h = self.control_dt / substeps
        force = self._six(wrench)
        rotation, position = self._midway(velocity, body)
        c, terms = self._coefficients, self._terms
        middle = np.zeros(self.per_share.shape[1])

        def rate(v: Array) -> Array:
            six, pushed = self._six(v), force
            if terms.fins:
                pushed = pushed + fin_wrench(c, terms, rotation, position, six, middle)
            return acceleration(c, terms, rotation, position, six, pushed)[..., self.degrees]

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

    def moved_to(self, body: Array, moved: Array) -> Array:
        """Position and quaternion (..., 7) after displacements (..., 6) along the body axes, from before."""
        quaternion = body[..., 3:]
        half = np.concatenate((np.ones_like(moved[..., :1]), moved[..., 3:] / 2), axis=-1)
        middle = np.concatenate((np.ones_like(moved[..., :1]), moved[..., 3:] / 4), axis=-1)
        turned = normalise(quaternion_product(quaternion, half))
        along = rotation_matrix(normalise(quaternion_product(quaternion, middle)))
        return np.concatenate((body[..., :3] + matvec(along, moved[..., :3]), turned), axis=-1)

    def flow(self, velocity: Array, share: Array) -> Array:
        """How strongly each actuator pushes, over what it does at the speed.

        Of a fin that is what its deflection adds to its lift, in the flow at its place: a fin that is set against a
        turn meets the flow at a larger angle, and stalls.

        Args:
            velocity: (N, D).
            share: (N, n) of full thrust that thrusters give, with which their servos push, and at which fins stand.

        Returns:
            (N, n), 1 of a thruster.
        """
        stronger = np.ones((len(velocity), len(self.fins)))
        if self.fins.any():
            six = self._six(velocity)
            six[:, 0] = np.clip(six[:, 0], 0.0, None)  # it is made to go ahead
            flow = np.clip(self._fin_push(six, share) / self._slope, 0.0, _STRONGEST)
            stronger = np.where(self.fins, flow, stronger)
        if self._turned is not None:
            stronger = np.where(self.servos & ~self.fins, share @ self._turned.T, stronger)
        return stronger

    def _fin_push(self, velocity: Array, share: Array) -> Array:
        """What a share (N, n) of its deflection adds to the lift of each fin at velocities (N, 6), N per share."""
        c, turned = self._coefficients, np.where(np.abs(share) > _SLIGHT, share, _SLIGHT)
        linear, angular = velocity[:, :3], velocity[:, 3:]
        pushed = [fin_forces(c, linear, angular, part * c.full_thrust) for part in (turned, 0.0 * turned)]
        return ((pushed[0] - pushed[1]) * c.direction).sum(-1) / turned

    def steady(self, velocity: Array) -> Array:
        """By how much wrenches that no command changes are larger at velocities (N, D), (N, k): not, and as at fins."""
        ones = np.ones((len(velocity), 1))
        if not self.fins.any():
            return ones
        stuck = self.flow(velocity, np.zeros((len(velocity), len(self.fins))))[:, self.fins]
        return np.concatenate((ones, stuck.mean(-1, keepdims=True)), axis=-1)

    def turning(self, before: Array, target: Array) -> tuple[Array, Array]:
        """Mean shares (N, n) over a control step of what follows its target as a servo does, and those at its end."""
        return shares_turned(self._coefficients, self._terms, before, target, self.control_dt)

    def _midway(self, velocity: Array, body: Array | None) -> tuple[Array, Array]:
        """Rotation and position about the middle of a step; level at the origin where no body is given."""
        if body is None:
            return np.broadcast_to(np.eye(3), (*velocity.shape[:-1], 3, 3)), np.zeros(3)
        body = np.broadcast_to(body, (*velocity.shape[:-1], 7))
        middle = self.moved_to(body, self.control_dt / 2 * self._six(velocity))
        return rotation_matrix(middle[..., 3:]), middle[..., :3]

    def _six(self, followed: Array) -> Array:
        full = np.zeros((*followed.shape[:-1], 6))
        full[..., self.degrees] = followed
        return full


def motion_of(vehicle: Vehicle, task: Task) -> SourceMotion:
    """Of a source vehicle (empty batch) in a task: its control step, its axes, its speed."""
    return SourceMotion(vehicle, task.control_dt, task.axes, cruise_speed(task))


def followed_axes(axes: Sequence[str], speed: float) -> tuple[str, ...]:
    """Degrees of freedom that are followed: those that are controlled of a vehicle that hovers, all six at speed."""
    return tuple(axes) if speed == 0.0 else DEGREES_OF_FREEDOM


def axis_weights(reach: Array, axes: Sequence[str], speed: float, config: AdaptationConfig) -> Array:
    """Weights (D,) on squared errors of what is pushed along the degrees of freedom that are followed.

    Args:
        reach: (D,) what all thrusters together can push, of any unit; 0 where they push nothing.
        axes: degrees of freedom that are controlled.
        speed: ahead in m/s, at which they are; 0 of a vehicle that hovers.
        config: says how little what is beside the axes counts, and the heading of a vehicle that hovers.
    """
    share = np.array([1.0 if axis in axes else config.aside_weight for axis in followed_axes(axes, speed)])
    if speed == 0.0:  # where it steers by its heading, a vehicle gives nothing of that away
        share[-1] *= config.heading_weight
    return np.where(reach > 0, np.square(share / np.where(reach > 0, reach, 1.0)), 0.0)
