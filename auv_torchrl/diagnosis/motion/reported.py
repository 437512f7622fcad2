"""From the motion that sensors report to the true one of a vehicle, and back.

Starts of windows are as reported, so that vehicles with other sensors begin where the same samples say that they do: a
vehicle whose compass is off by half a turn begins there turned round, one whose lengths are doubled at half the place
and half the speed.
"""

import numpy as np

from auv_torchrl.diagnosis.motion.windows import CHANNELS, Floats
from auv_torchrl.physics import Coefficients
from auv_torchrl.physics.kinematics import matvec, quaternion_from_euler, quaternion_product, rotation_matrix
from auv_torchrl.physics.sensors import position_gain, velocity_gain


def reported_per_true(c: Coefficients) -> Floats:
    """Factors (R, 12) from what is true to what sensors report, by channel."""
    angles = np.ones((*c.position_scale.shape, 3))
    return np.concatenate([position_gain(c), angles, velocity_gain(c), angles], axis=-1)


def true_per_reported(c: Coefficients, channels: tuple[str, ...]) -> Floats:
    """Factors (R, 12) from a reported start to the true one.

    A speed is what positions change by, or where no position is measured, what velocities say.
    """
    reported = reported_per_true(c)
    true = 1.0 / reported
    for velocity, position in zip(CHANNELS[6:9], CHANNELS[:3], strict=True):
        source = position if position in channels else velocity
        true[..., CHANNELS.index(velocity)] = 1.0 / reported[..., CHANNELS.index(source)]
    return true


def depth_offset(c: Coefficients) -> Floats:
    """What is added (R, 3) to a position in m, as reported."""
    zero = np.zeros_like(c.depth_bias)
    return np.stack([zero, zero, c.depth_bias], axis=-1)


def as_true(c: Coefficients, channels: tuple[str, ...], position: Floats, velocity: Floats) -> tuple[Floats, Floats]:
    """True position (..., 3) and body velocity (..., 6) of reported ones, axes of the body as they are."""
    factor = true_per_reported(c, channels)
    return (position - depth_offset(c)) * factor[..., :3], velocity * factor[..., 6:]


def as_reported(
    c: Coefficients, channels: tuple[str, ...], position: Floats, velocity: Floats
) -> tuple[Floats, Floats]:
    """The inverse of :func:`as_true`."""
    factor = true_per_reported(c, channels)
    return position / factor[..., :3] + depth_offset(c), velocity / factor[..., 6:]


def turned(c: Coefficients) -> Floats:
    """Rotations (R, 6, 6) of forces and velocities from the body axes of the reported heading to the true ones."""
    zero = np.zeros_like(c.heading_bias)
    both = np.zeros((*c.heading_bias.shape, 6, 6))
    both[..., :3, :3] = both[..., 3:, 3:] = rotation_matrix(quaternion_from_euler(zero, zero, c.heading_bias))
    return both


def reported_motion(c: Coefficients, channels: tuple[str, ...], motion: Floats) -> Floats:
    """Motion (W, S, 13) as the sensors of one vehicle (1,) report it, of its true motion."""
    position, velocity = as_reported(c, channels, motion[..., :3], matvec(turned(c).mT, motion[..., 7:]))
    zero = np.zeros_like(c.heading_bias)
    quaternion = quaternion_product(quaternion_from_euler(zero, zero, c.heading_bias), motion[..., 3:7])
    return np.concatenate([position, quaternion, velocity], axis=-1)


def true_forces(c: Coefficients, channels: tuple[str, ...], rate: Floats) -> Floats:
    """Accelerations (..., 6) in the true axes and units of one vehicle (1,), of reported ones."""
    return matvec(turned(c), rate * true_per_reported(c, channels)[..., 6:])
