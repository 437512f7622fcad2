"""What sensors feel of how a motion changes: read over a path of states, as means over its steps.

An accelerometer reports what no state tells by itself. Between two neighbours of a path it is what the velocity changed
by, and the weight: nothing is asked of the equations of motion again.
"""

from typing import Any

import numpy as np
from array_api_compat import array_namespace

from auv_torchrl.physics.coefficients import Coefficients
from auv_torchrl.physics.kinematics import least_turn
from auv_torchrl.sensors.instruments import read, sensor_of

Array = Any


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
    xp = array_namespace(motion)
    change = motion[..., 1:, :] - motion[..., :-1, :]
    rate = xp.concat((change[..., :3], least_turn(change[..., 3:6]), change[..., 6:]), axis=-1) / dt
    steady = read(c, channels, motion)
    return 0.5 * (steady[..., 1:, :] + steady[..., :-1, :]) + moving(c, channels, rate)
