"""The state that an observation of the regulation task was made from."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from auv_torchrl.physics.kinematics import matvec, quaternion_from_euler, rotation_matrix

Array = Any
_SPEED = ("surge_speed", "sway_speed", "heave_speed")
_RATE = ("roll_rate", "pitch_rate", "yaw_rate")
_ERROR = ("error_x", "error_y", "error_z")


class MeasuredState:
    """Turns observations back into the pose and velocity that were measured; level where tilt is not observed.

    Args:
        observation_names: of the task.
    """

    def __init__(self, observation_names: Sequence[str]):
        place = {name: i for i, name in enumerate(observation_names)}
        self._speed = [place[name] for name in _SPEED]
        self._rate = [place.get(name) for name in _RATE]
        self._error = [place[name] for name in _ERROR]
        self._heading = [place["heading_error_sin"], place["heading_error_cos"]]
        self._down = [place["down_x"], place["down_y"]] if "down_x" in place else None

    def __call__(self, observation: Array) -> tuple[Array, Array, Array]:
        """Position (N, 3) in m, quaternion (N, 4) and body velocity (N, 6) of observations (N, d); float64."""
        still = np.zeros(len(observation))
        rates = [still if i is None else observation[:, i] for i in self._rate]
        velocity = np.concatenate((observation[:, self._speed], np.stack(rates, axis=-1)), axis=-1)
        yaw = -np.arctan2(*observation[:, self._heading].T)
        x, y = (still, still) if self._down is None else np.clip(observation[:, self._down], -1.0, 1.0).T
        z = np.sqrt(np.clip(1.0 - x * x - y * y, 0.0, None))
        quaternion = quaternion_from_euler(np.arctan2(y, z), -np.arcsin(x), yaw)
        return -matvec(rotation_matrix(quaternion), observation[:, self._error]), quaternion, velocity
