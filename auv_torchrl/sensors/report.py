"""What the sensors of a simulated vehicle report at every control step: late, scaled, biased, noisy."""

from typing import Any

from array_api_compat import array_namespace

from auv_torchrl.physics.coefficients import Coefficients
from auv_torchrl.physics.kinematics import euler_angles, normalise, quaternion_from_euler, quaternion_product
from auv_torchrl.physics.thrusters import delayed
from auv_torchrl.sensors.instruments import ages, read
from auv_torchrl.sensors.sensor import MOTION

Array = Any
_POSE, _VELOCITY = MOTION[:6], MOTION[6:]


def measured_pose(
    c: Coefficients, poses: Array, control_dt: float, noise: Array | None = None, load: Array | None = None
) -> tuple[Array, Array]:
    """Position (..., 3) in m and quaternion (..., 4) as reported.

    Args:
        c: coefficients of the vehicles.
        poses: (..., L, 7) past poses, position then quaternion, newest first.
        control_dt: seconds between them.
        noise: (..., 6) standard normal draws, position then roll, pitch, yaw; None for none.
        load: (...) share of their full thrusts that thrusters give; None for none.
    """
    pose = delayed(poses, ages(c, ("x",))[..., 0], control_dt) if poses.shape[-2] > 1 else poses[..., 0, :]
    reported = read(c, _POSE, motion_of(pose), load)
    position, quaternion = reported[..., :3], quaternion_from_euler(*(reported[..., i] for i in (3, 4, 5)))
    if noise is not None:
        position = position + c.position_noise[..., None] * noise[..., :3]
        angle = c.attitude_noise[..., None] * noise[..., 3:]
        quaternion = quaternion_product(quaternion, quaternion_from_euler(angle[..., 0], angle[..., 1], angle[..., 2]))
    return position, quaternion


def measured_velocity(c: Coefficients, velocity: Array) -> Array:
    """Body velocity (..., 6) in m/s and rad/s as reported."""
    xp = array_namespace(velocity)
    return read(c, _VELOCITY, xp.concat((xp.zeros_like(velocity), velocity), axis=-1))


def motion_of(states: Array) -> Array:
    """The 12 numbers (..., 12) of states (..., 13): position, quaternion, velocity; zero velocity of poses (..., 7)."""
    xp = array_namespace(states)
    angles = xp.stack(euler_angles(normalise(states[..., 3:7])), axis=-1)
    velocity = states[..., 7:] if states.shape[-1] > 7 else xp.zeros_like(states[..., :6])
    return xp.concat((states[..., :3], angles, velocity), axis=-1)
