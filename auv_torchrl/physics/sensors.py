"""What the vehicle's sensors report: a pose that is late, scaled, biased and noisy, and a scaled velocity."""

from typing import Any

from array_api_compat import array_namespace

from auv_torchrl.physics.coefficients import Coefficients
from auv_torchrl.physics.kinematics import normalise, quaternion_from_euler, quaternion_product
from auv_torchrl.physics.thrusters import delayed

Array = Any


def measured_pose(c: Coefficients, poses: Array, control_dt: float, noise: Array | None = None) -> tuple[Array, Array]:
    """Position (..., 3) in m and quaternion (..., 4) as reported.

    Args:
        c: coefficients of the vehicles.
        poses: (..., L, 7) past poses, position then quaternion, newest first.
        control_dt: seconds between them.
        noise: (..., 6) standard normal draws, position then roll, pitch, yaw; None for none.
    """
    xp = array_namespace(poses)
    pose = delayed(poses, c.pose_delay, control_dt) if poses.shape[-2] > 1 else poses[..., 0, :]
    zero = xp.zeros_like(c.heading_bias)
    position = pose[..., :3] * position_gain(c) + xp.stack((zero, zero, c.depth_bias), axis=-1)
    quaternion = normalise(pose[..., 3:])
    turn = quaternion_from_euler(zero, zero, c.heading_bias)
    quaternion = quaternion_product(turn, quaternion)
    if noise is not None:
        position = position + c.position_noise[..., None] * noise[..., :3]
        angle = c.attitude_noise[..., None] * noise[..., 3:]
        quaternion = quaternion_product(quaternion, quaternion_from_euler(angle[..., 0], angle[..., 1], angle[..., 2]))
    return position, quaternion


def position_gain(c: Coefficients) -> Array:
    """Reported over true position, (..., 3)."""
    xp = array_namespace(c.position_scale)
    return xp.stack((c.position_scale, c.position_scale, c.position_scale * c.depth_scale), axis=-1)


def velocity_gain(c: Coefficients) -> Array:
    """Reported over true linear velocity, (..., 3)."""
    xp = array_namespace(c.velocity_scale)
    return xp.stack((c.velocity_scale,) * 3, axis=-1)


def measured_velocity(c: Coefficients, velocity: Array) -> Array:
    """Body velocity (..., 6) in m/s and rad/s as reported."""
    xp = array_namespace(velocity)
    return xp.concat((velocity[..., :3] * velocity_gain(c), velocity[..., 3:]), axis=-1)
