"""What the sensors of a simulated vehicle report at every control step: late, scaled, biased, noisy."""

from typing import Any

import numpy as np
from array_api_compat import array_namespace

from auv_torchrl.physics.coefficients import Coefficients
from auv_torchrl.physics.kinematics import (
    euler_angles,
    least_turn,
    normalise,
    quaternion_from_euler,
    quaternion_product,
)
from auv_torchrl.physics.thrusters import delayed
from auv_torchrl.sensors.instruments import ages, read, sensor_of
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
    roll, pitch, yaw = (angle[..., None] for angle in euler_angles(normalise(states[..., 3:7])))
    velocity = states[..., 7:] if states.shape[-1] > 7 else xp.zeros_like(states[..., :6])
    return xp.concat((states[..., :3], roll, pitch, yaw, velocity), axis=-1)


def is_felt(channels: tuple[str, ...]) -> np.ndarray:
    """(C,) True for channels that are read over a path, see :attr:`auv_torchrl.sensors.Sensor.moving`."""
    return np.array([sensor_of(channel).moving is not None for channel in channels], bool)


def moving(c: Coefficients, channels: tuple[str, ...], rate: Array) -> Array:
    """What felt ``channels`` report (..., C) of how fast a motion changes, ``rate`` (..., 12) per s, alone."""
    xp = array_namespace(rate)
    columns: list[Array] = []
    for channel in channels:
        sensor = sensor_of(channel)
        if sensor.moving is None:
            raise ValueError(f"sensor {sensor.name}: {channel} is read of a state and not over a path")
        columns.append(sensor.moving(c, rate)[..., sensor.channels.index(channel)])
    return xp.stack(tuple(xp.broadcast_arrays(*columns)), axis=-1)


def felt_at_rows(c: Coefficients, channels: tuple[str, ...], motion: Array, dt: float) -> Array:
    """What a log with rows at the states of a ``motion`` (..., T, 12) says of felt ``channels``, (..., T, C).

    Each row has the mean from half a step before to half a step after, the first and the last one of a half alone.
    """
    xp = array_namespace(motion)
    steps = felt_along(c, channels, motion, dt)
    return xp.concat((steps[..., :1, :], 0.5 * (steps[..., 1:, :] + steps[..., :-1, :]), steps[..., -1:, :]), axis=-2)


def felt_along(c: Coefficients, channels: tuple[str, ...], motion: Array, dt: float) -> Array:
    """What felt ``channels`` report (..., L - 1, C), on the mean over each step, along a ``motion`` (..., L, 12).

    The motion is of states ``dt`` s apart; vehicles ``c`` have a batch axis for them.
    """
    rate = motion[..., 1:, :] - motion[..., :-1, :]
    rate[..., 3:6] = least_turn(rate[..., 3:6])
    rate /= dt
    steady = read(c, channels, motion)
    return 0.5 * (steady[..., 1:, :] + steady[..., :-1, :]) + moving(c, channels, rate)
