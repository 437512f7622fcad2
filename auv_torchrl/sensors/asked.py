"""Which coefficients of a vehicle its sensors ask for: found by letting them read, so that a new one needs no line."""

from typing import Any, cast

import numpy as np

from auv_torchrl.physics.coefficients import Coefficients
from auv_torchrl.physics.thrusters import TARGET_FIELDS
from auv_torchrl.sensors.instruments import ages, read
from auv_torchrl.sensors.path import is_felt, moving
from auv_torchrl.sensors.sensor import MOTION


class _Watched:
    """Coefficients that remember which of them were asked for."""

    def __init__(self, c: Coefficients):
        self._c = c
        self.names: set[str] = set()

    def __getattr__(self, name: str) -> Any:
        self.names.add(name)
        return getattr(self._c, name)


def coefficients_asked(c: Coefficients, channels: tuple[str, ...]) -> tuple[str, ...]:
    """Names of the coefficients on which reports of a vehicle ``c`` (1,) depend in logs with ``channels``.

    A vehicle that equals it in all of these reports the same of a motion.
    """
    watched = _Watched(c)
    seen = cast(Coefficients, watched)
    motion, felt = np.zeros((1, 12)), tuple(np.array(channels)[is_felt(channels)])
    read(seen, (*MOTION, *felt), motion, np.zeros(1))
    ages(seen, channels)
    if felt:
        moving(seen, felt, motion)
    if not watched.names <= set(Coefficients._fields):  # asked for all of them at once
        return Coefficients._fields
    loaded = (*TARGET_FIELDS, "gain") if c.compass_per_load.any() else ()
    return tuple(sorted(watched.names | set(loaded)))


def report_otherwise(before: Coefficients, after: Coefficients, channels: tuple[str, ...]) -> np.ndarray:
    """Numbers of the vehicles (R,) that differ from a vehicle (1,) in something that their sensors ask for."""
    other = np.zeros(len(after.lag), bool)
    for name in coefficients_asked(before, channels):
        other |= (getattr(after, name) != getattr(before, name)).reshape(len(other), -1).any(1)
    return np.flatnonzero(other)
