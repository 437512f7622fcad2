"""From measured states to what the filter reads: speeds, or displacement along the body axes from pose alone."""

from typing import Any, NamedTuple

import numpy as np

from auv_torchrl.adaptation.config import AdaptationConfig
from auv_torchrl.adaptation.memory import Memory
from auv_torchrl.physics.kinematics import euler_angles, wrap_angle
from auv_torchrl.vehicle import CONTROLLED_INDEX

Array = Any
VELOCITY = [7 + index for index in CONTROLLED_INDEX]  # in a state: position, quaternion, velocity
TILT_RATES = [10, 11]


class Reading(NamedTuple):
    """One measurement of N vehicles, float64."""

    raw: Array  # (N, 8) velocity, position, heading, as measured; velocity 0 where only the pose is
    measured: Array  # (N, 4) speed, or displacement since the motion began
    variance: Array  # (N, 4)


class Sensing(Memory):
    """Reads measured states.

    Displacement is summed along the body axes from differences of position; its noise is that of the two ends.

    Args:
        config: what is measured, how well.
        count: number of vehicles N.
    """

    pose: Array  # (N, 4) the last one that was usable
    travelled: Array  # (N, 4) displacement up to it

    def __init__(self, config: AdaptationConfig, count: int):
        super().__init__()
        self.config = config
        self.remember(pose=np.zeros((count, 4)), travelled=np.zeros((count, 4)))

    def read(self, state: Array) -> Reading:
        """What measured states (N, 13) say."""
        config = self.config
        state = np.where(np.isfinite(state).all(-1, keepdims=True), state, np.nan)  # one bad value spoils a measurement
        velocity, position, heading = state[:, VELOCITY], state[:, :3], euler_angles(state[:, 3:7])[2]
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
        state[:, VELOCITY] = velocity
        state[:, TILT_RATES] = 0.0  # of a vehicle that its weight holds level
        return state

    def accept(self, reading: Reading, rows: Array) -> None:
        """The next displacement counts from this reading in these rows, (N,) bool."""
        self.pose[rows] = reading.raw[rows, 4:]
        self.travelled[rows] = reading.measured[rows] if self.config.sensed == "pose" else 0.0

    def restart(self, reading: Reading, rows: Array) -> None:
        """Displacement is 0 at this reading in these rows."""
        self.pose[rows] = np.nan_to_num(reading.raw[rows, 4:])
        self.travelled[rows] = 0.0


def turned(vector: Array, angle: Array) -> Array:
    """Vectors (N, 3) turned about z by angles (N,): from body to earth for a heading."""
    c, s = np.cos(angle), np.sin(angle)
    x, y = vector[:, 0], vector[:, 1]
    return np.stack((c * x - s * y, s * x + c * y, vector[:, 2]), axis=-1)
