"""From measured states to what the filter reads, and which measurements can be used."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from auv_torchrl.adaptation.config import AdaptationConfig
from auv_torchrl.adaptation.memory import Memory
from auv_torchrl.physics.kinematics import heading_of, wrap_angle
from auv_torchrl.vehicle import CONTROLLED_INDEX

Array = Any
VELOCITY = tuple(7 + index for index in CONTROLLED_INDEX)  # in a state: position, quaternion, velocity
TILT_RATES = [10, 11]


class Reading(NamedTuple):
    """One measurement of N vehicles in D degrees of freedom, float64."""

    raw: Array  # (N, D + 4) velocity, position, heading, as measured; velocity 0 where only the pose is
    measured: Array  # (N, D) speed, or displacement since the motion began
    variance: Array  # (N, D)


class Sensing(Memory):
    """Reads measured states.

    Displacement is summed along the body axes from differences of position; its noise is that of the two ends.

    Args:
        config: what is measured, how well.
        count: number of vehicles N.
        velocity: places of the D velocities in a state: position, quaternion, velocity.
    """

    pose: Array  # (N, 4) the last one that was usable
    travelled: Array  # (N, 4) displacement up to it

    def __init__(self, config: AdaptationConfig, count: int, velocity: Sequence[int] = VELOCITY):
        super().__init__()
        self.config, self.velocity = config, list(velocity)
        self.remember(pose=np.zeros((count, 4)), travelled=np.zeros((count, 4)))

    def read(self, state: Array) -> Reading:
        """What measured states (N, 13) say."""
        config = self.config
        state = np.where(np.isfinite(state).all(-1, keepdims=True), state, np.nan)  # one bad value spoils a measurement
        velocity, position, heading = state[:, self.velocity], state[:, :3], heading_of(state[:, 3:7])
        if config.sensed == "pose":
            velocity = 0.0 * velocity
        raw = np.concatenate((velocity, position, heading[:, None]), axis=-1)
        if config.sensed == "velocity":
            return Reading(raw, velocity, np.full(velocity.shape, config.velocity_noise**2))
        turn = wrap_angle(heading - self.pose[:, 3])
        moved = turned(position - self.pose[:, :3], -(self.pose[:, 3] + turn / 2))
        measured = self.travelled + np.concatenate((moved, turn[:, None]), axis=-1)
        noise = np.array((*(config.position_noise,) * 3, config.heading_noise))
        return Reading(raw, measured, np.broadcast_to(np.square(noise), measured.shape))

    def shown(self, state: Array, velocity: Array) -> Array:
        """States (N, 13) that a policy may see: where only the pose is measured, with estimated velocities (N, 4)."""
        if self.config.sensed == "velocity":
            return state
        state = state.copy()
        state[:, self.velocity] = velocity
        state[:, TILT_RATES] = 0.0  # of a vehicle that its weight holds level
        return state

    def accept(self, reading: Reading, rows: Array) -> None:
        """The next displacement counts from this reading in these rows, (N,) bool."""
        self.pose[rows] = reading.raw[rows, -4:]
        self.travelled[rows] = reading.measured[rows] if self.config.sensed == "pose" else 0.0

    def restart(self, reading: Reading, rows: Array) -> None:
        """Displacement is 0 at this reading in these rows."""
        self.pose[rows] = np.nan_to_num(reading.raw[rows, -4:])
        self.travelled[rows] = 0.0


def turned(vector: Array, angle: Array) -> Array:
    """Vectors (N, 3) turned about z by angles (N,): from body to earth for a heading."""
    c, s = np.cos(angle), np.sin(angle)
    x, y = vector[:, 0], vector[:, 1]
    return np.stack((c * x - s * y, s * x + c * y, vector[:, 2]), axis=-1)


class Verdict(NamedTuple):
    """Per vehicle, (N,) bool."""

    usable: Array  # the measurement may be learnt from
    restart: Array  # the motion begins anew at this measurement: time or place has jumped


class MeasurementGuard(Memory):
    """Judges the measurements of N vehicles one after another.

    A measurement is lost where it is not finite; frozen where every bit equals the one before although the
    thrusters push; impossible where it lies further from the expected one than thrusters can bring it.

    Args:
        count: number of vehicles N.
        control_dt: s between two measurements.
        reach: (D,) change of a measured value in one step by the full wrench.
        tolerance: (D,) difference that noise and uncertainty explain.
        config: says how late and how far off a measurement may be.
    """

    previous: Array  # (N, D + 4) the last measurement
    time: Array  # (N,) s, of it
    impossible: Array  # (N,) number of impossible measurements in a row

    def __init__(self, count: int, control_dt: float, reach: Array, tolerance: Array, config: AdaptationConfig):
        super().__init__()
        self.control_dt, self.config = control_dt, config
        self.bound = config.largest_reach * reach + tolerance
        nothing = np.full((count, len(reach) + 4), np.nan)
        self.remember(previous=nothing, time=np.full(count, np.nan), impossible=np.zeros(count, dtype=np.int64))

    def begin(self, rows: Array) -> None:
        """A new episode of some vehicles: nothing came before."""
        self.time[rows] = np.nan
        self.previous[rows] = np.nan
        self.impossible[rows] = 0

    def judge(self, raw: Array, time: Array, difference: Array, pushing: Array) -> Verdict:
        """One measurement of each vehicle.

        Args:
            raw: (N, D + 4) everything measured, to be compared bit by bit with the one before.
            time: (N,) s.
            difference: (N, D) measured less expected; NaN where the measurement is.
            pushing: (N,) bool, whether any thruster was commanded to push.
        """
        finite = np.isfinite(raw).all(-1) & np.isfinite(difference).all(-1) & np.isfinite(time)
        frozen = (raw == self.previous).all(-1) & pushing
        elapsed = time - self.time
        in_time = np.isnan(self.time) | (np.abs(elapsed - self.control_dt) < self.config.late_share * self.control_dt)
        with np.errstate(invalid="ignore"):
            possible = (np.abs(difference) < self.bound).all(-1)
        present = finite & ~frozen
        self.impossible = np.where(present & ~possible, self.impossible + 1, np.where(present, 0, self.impossible))
        moved = self.impossible >= self.config.believed_after
        self.impossible[moved] = 0
        restart = present & (~in_time | moved)
        self.previous = raw.copy()
        self.time = np.where(np.isfinite(time), time, self.time + self.control_dt)
        return Verdict(usable=present & in_time & possible, restart=restart)
