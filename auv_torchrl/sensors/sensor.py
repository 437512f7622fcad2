"""What a sensor is: some channels of a log, read from the true motion of the vehicle, and how old they are then."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from array_api_compat import array_namespace

from auv_torchrl.physics.coefficients import Coefficients

Array = Any
# The 12 numbers of a motion: m in the earth frame (NED), rad, then m/s and rad/s over ground in the body frame (FRD).
MOTION = ("x", "y", "z", "roll", "pitch", "yaw", "u", "v", "w", "p", "q", "r")
# What is felt of how a motion changes: specific force in m/s^2 in the body frame, (0, 0, -9.81) at rest. It jumps where
# a command does, so that a log holds means of it over the time around each of its rows.
FELT = ("ax", "ay", "az")
CHANNELS = MOTION + FELT


@dataclass(frozen=True)
class Sensor:
    """An instrument that reports some channels.

    ``read(c, motion)`` is what it reports, (..., k) for its ``k`` channels, of a motion (..., 12), without noise;
    ``loaded(c, load)`` is what it reports besides, (..., k), while thrusters give a share ``load`` (...) of their all;
    ``moving(c, rate)`` is what it reports besides, (..., k), in proportion to how fast a motion changes, ``rate``
    (..., 12) per s: such a sensor is read over a path, see :func:`auv_torchrl.sensors.felt_along`;
    ``age(c)`` how long ago, in s, the vehicle moved as its reports of this moment say, () for each vehicle.
    """

    name: str
    channels: tuple[str, ...]
    meaning: str
    read: Callable[[Coefficients, Array], Array]
    age: Callable[[Coefficients], Array]
    loaded: Callable[[Coefficients, Array], Array] | None = None
    moving: Callable[[Coefficients, Array], Array] | None = None


def at_once(c: Coefficients) -> Array:
    """The age of what is reported without delay."""
    return array_namespace(c.position_scale).zeros_like(c.position_scale)
