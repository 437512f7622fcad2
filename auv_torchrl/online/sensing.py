"""From observations to what the filter reads: speeds, or displacement along the body axes from pose alone."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from auv_torchrl.online.config import OnlineConfig
from auv_torchrl.physics.kinematics import wrap_angle

Array = Any
_VELOCITY = ("surge_speed", "sway_speed", "heave_speed", "yaw_rate")
_ERROR = ("error_x", "error_y", "error_z")
_HEADING = ("heading_error_sin", "heading_error_cos")
_TILT_RATES = ("roll_rate", "pitch_rate")


class Reading(NamedTuple):
    """One measurement of N vehicles, float64."""

    raw: Array  # (N, 8) velocity, position, heading, as measured; velocity 0 where only the pose is
    measured: Array  # (N, 4) speed, or displacement since the motion began
    variance: Array  # (N, 4)


class Sensing:
    """Reads the observations of a regulation task.

    Displacement is summed along the body axes from differences of position; its noise is that of the two ends.

    Args:
        observation_names: of the task.
        config: what is measured, how well.
        count: number of vehicles N.
    """

    FIELDS = ("pose", "travelled")  # the last pose that was usable, and the displacement up to it

    def __init__(self, observation_names: Sequence[str], config: OnlineConfig, count: int):
        self.config = config
        self._velocity, self._error, self._heading = (
            [observation_names.index(name) for name in names] for names in (_VELOCITY, _ERROR, _HEADING)
        )
        self._rates = [i for i, name in enumerate(observation_names) if name in _TILT_RATES]
        self.pose = np.zeros((count, 4))
        self.travelled = np.zeros((count, 4))

    def read(self, observation: Array) -> Reading:
        """What observations (N, d) say."""
        config = self.config
        finite = np.isfinite(observation).all(-1, keepdims=True)
        observation = np.where(finite, observation, np.nan)  # one bad value spoils a measurement
        velocity, error = observation[:, self._velocity], observation[:, self._error]
        heading = -np.arctan2(*observation[:, self._heading].T)
        position = -_turned(error, heading)
        if config.sensed == "pose":
            velocity = 0.0 * velocity
        raw = np.concatenate((velocity, position, heading[:, None]), axis=-1)
        if config.sensed == "velocity":
            return Reading(raw, velocity, np.full(velocity.shape, config.velocity_noise**2))
        turn = wrap_angle(heading - self.pose[:, 3])
        moved = _turned(position - self.pose[:, :3], -(self.pose[:, 3] + turn / 2))
        measured = self.travelled + np.concatenate((moved, turn[:, None]), axis=-1)
        tilt = np.square(config.heading_noise) * np.square(error).sum(-1)  # roll and pitch noise turn the far target
        position_variance = (config.position_noise**2 + tilt)[:, None].repeat(3, axis=1)
        heading_variance = np.full((len(raw), 1), config.heading_noise**2)
        return Reading(raw, measured, np.concatenate((position_variance, heading_variance), axis=-1))

    def shown(self, observation: Array, velocity: Array) -> Array:
        """Observations (N, d) that a policy may see: where only the pose is measured, estimated velocities (N, 4)."""
        if self.config.sensed == "velocity":
            return observation
        observation = observation.copy()
        observation[:, self._velocity] = velocity
        observation[:, self._rates] = 0.0  # of a vehicle that its weight holds level
        return observation

    def accept(self, reading: Reading, rows: Array) -> None:
        """The next displacement counts from this reading in these rows, (N,) bool."""
        self.pose[rows] = reading.raw[rows, 4:]
        self.travelled[rows] = reading.measured[rows] if self.config.sensed == "pose" else 0.0

    def restart(self, reading: Reading, rows: Array) -> None:
        """Displacement is 0 at this reading in these rows."""
        self.pose[rows] = np.nan_to_num(reading.raw[rows, 4:])
        self.travelled[rows] = 0.0


def _turned(vector: Array, angle: Array) -> Array:
    """Vectors (N, 3) turned about z by angles (N,): from body to earth for a heading."""
    c, s = np.cos(angle), np.sin(angle)
    x, y = vector[:, 0], vector[:, 1]
    return np.stack((c * x - s * y, s * x + c * y, vector[:, 2]), axis=-1)
