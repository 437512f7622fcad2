"""Quaternions (w, x, y, z) that turn body vectors into the earth frame, and the angles that stand for them."""

import numpy as np

from auv_torchrl.flightlog.streams.stream import Floats
from auv_torchrl.physics import kinematics


def euler_angles(quaternion: Floats) -> Floats:
    """Roll, pitch and yaw (T, 3) in radians, ZYX; NaN for what is no quaternion."""
    size = np.linalg.norm(quaternion, axis=-1, keepdims=True)
    return np.stack(kinematics.euler_angles(quaternion / np.where(np.abs(size - 1) < 0.1, size, np.nan)), axis=-1)


def ned_of_enu(quaternion: Floats) -> Floats:
    """The attitude (T, 4) of an FRD body in NED from that of an FLU body in ENU, as REP 103 has it."""
    w, x, y, z = np.moveaxis(quaternion, -1, 0)
    half = np.sqrt(0.5)  # NED from ENU is half a turn about (1, 1, 0); FLU from FRD is half a turn about x
    return half * np.stack((w + z, x + y, x - y, w - z), axis=-1)


def ned_of_enu_vector(vector: Floats) -> Floats:
    """East, north, up (T, 3) as north, east, down."""
    return vector[..., [1, 0, 2]] * np.array([1.0, 1.0, -1.0])


def frd_of_flu(vector: Floats) -> Floats:
    """Forward, left, up (T, 3) as forward, right, down."""
    return vector * np.array([1.0, -1.0, -1.0])
