"""How fast the estimates of a filter go astray: the rate of their error, which is slow, and no noise on every sample.

A filter integrates its gyro and accelerometer and is corrected by slower sensors. From one sample to the next its
estimates are smooth to the last digit, and within seconds all of them are off together.
"""

import numpy as np

from auv_torchrl.flightlog.log import ANGLES, POSE
from auv_torchrl.flightlog.signals import integral, interpolate
from auv_torchrl.flightlog.streams.stream import Floats, Sampling, Stream
from auv_torchrl.physics.kinematics import conjugate, quaternion_from_euler, quaternion_product

DRIFT_S = 4.0  # s, over which the rate of the error of a filter lasts: as long as its corrections take
POSITION_DRIFT = 0.05  # m/s, where nothing is said; filters of underwater vehicles in flight are off by 0.03 to 0.1
ANGLE_DRIFT = 0.002  # rad/s, likewise
STEP_S = 0.01  # s, from one angle to the next; closer ones turn so little that they say nothing of their own
MOST_ANGLES = 1_000_000  # that are compared, of a log of any length
COMPARED_S = 2.0  # s, over which angles are compared with the turning that the gyro felt


def drift_of(stream: Stream, gyro: Stream | None) -> float:
    """Standard deviation of the rate at which a stream of angles or positions goes astray, per s; 0 for a sensor.

    As its source says; of angles, as far as they turn otherwise than the ``gyro``; else what filters usually do.
    """
    if stream.sampling is not Sampling.ESTIMATED or not set(stream.channels) <= set(POSE):
        return 0.0
    if stream.drift is not None:
        return stream.drift
    if not set(stream.channels) <= set(ANGLES):
        return POSITION_DRIFT
    found = None if gyro is None or gyro.channels != ("p", "q", "r") else _apart(stream, gyro)
    return ANGLE_DRIFT if found is None else found


def _apart(attitude: Stream, gyro: Stream) -> float | None:
    """How far off an attitude (roll, pitch, yaw) turns from what its gyro felt, rad/s; None if they hardly overlap."""
    if attitude.channels != ANGLES or min(len(attitude), len(gyro)) < 2:
        return None
    inside = (attitude.t >= gyro.t[0]) & (attitude.t <= gyro.t[-1])
    known = np.flatnonzero(np.isfinite(attitude.values).all(-1) & inside)
    dense = max(1, int(STEP_S / attitude.interval), len(known) // MOST_ANGLES)
    known = known[::dense]
    t, felt = attitude.t[known], np.isfinite(gyro.values).all(-1)
    every = max(1, round(COMPARED_S / (dense * attitude.interval)))
    if len(t) < 20 * every or felt.sum() < 2:
        return None
    turned = _turned(attitude.values[known])
    gyro_t, rate = gyro.t[felt], gyro.values[felt]
    by_gyro = interpolate(t, gyro_t, integral(gyro_t, rate))
    apart, lasting = (turned - by_gyro)[::every], np.diff(t[::every])
    usual = lasting < 1.5 * COMPARED_S
    rates = np.abs(np.diff(apart, axis=0)[usual] / lasting[usual, None])
    return float(1.4826 * np.median(rates, axis=0).max()) if len(rates) else None


def _turned(angles: Floats) -> Floats:
    """The turning (T, 3) in rad that an attitude (T, 3) went through since its first sample, about the body's axes."""
    at = quaternion_from_euler(*angles.T)
    step = quaternion_product(conjugate(at[:-1]), at[1:])
    step = 2 * step[:, 1:] * np.sign(step[:, :1])  # small angles
    return np.concatenate([np.zeros((1, 3)), np.cumsum(step, axis=0)])
