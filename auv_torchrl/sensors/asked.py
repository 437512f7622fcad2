"""Which coefficients of a vehicle its sensors ask for: found by letting them read, so that a new one needs no line."""

from typing import Any, cast

import numpy as np

from auv_torchrl.physics.coefficients import Coefficients
from auv_torchrl.physics.thrusters import TARGET_FIELDS
from auv_torchrl.sensors.instruments import ages, read
from auv_torchrl.sensors.report import is_felt, moving
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
    """Names of the coefficients on which the reports of vehicles ``c`` (R,) depend in logs with ``channels``.

    Those of them that are equal in all of these report the same of a motion.
    """
    return _asked(c, channels, (*MOTION, *np.array(channels)[is_felt(channels)]))


def report_otherwise(before: Coefficients, after: Coefficients, channels: tuple[str, ...]) -> np.ndarray:
    """(R,) True for vehicles (R,) that may report something else than a vehicle (1,) of one true motion.

    A scale of positions is nothing to a log without positions, though its vehicle moves otherwise than reported.
    """
    names = {*_asked(before, channels, channels), *_asked(after, channels, channels)}
    apart = [getattr(after, name) != getattr(before, name) for name in names]
    return np.any([each.reshape(len(after.lag), -1).any(-1) for each in apart], axis=0)


def _asked(c: Coefficients, channels: tuple[str, ...], reported: tuple[str, ...]) -> tuple[str, ...]:
    """Names of the coefficients that ``reported`` numbers ask for in a log with ``channels``."""
    watched = _Watched(c)
    seen = cast(Coefficients, watched)
    motion, felt = np.zeros((len(c.lag), 12)), tuple(np.array(channels)[is_felt(channels)])
    read(seen, reported, motion, np.zeros(len(c.lag)))
    ages(seen, channels)
    if felt:
        moving(seen, felt, motion)
    if not watched.names <= set(Coefficients._fields):  # asked for all of them at once
        return Coefficients._fields
    loaded = (*TARGET_FIELDS, "gain") if c.compass_per_load.any() else ()
    return tuple(sorted(watched.names | set(loaded)))


def report_the_same(
    before: Coefficients, after: Coefficients, channels: tuple[str, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Vehicles (K,), of all (R,), that may report something else than a vehicle (1,), and which each (R,) is like.

    -1 is one that reports what that vehicle does.
    """
    names = {*coefficients_asked(before, channels), *coefficients_asked(after, channels)}
    fields = [[getattr(c, name).reshape(len(c.lag), -1) for name in sorted(names)] for c in (before, after)]
    now, *rows = (row.tobytes() for row in np.concatenate([np.concatenate(its, axis=1) for its in fields]))
    first: list[int] = []
    known, kind = {now: -1}, np.empty(len(rows), int)
    for place, row in enumerate(rows):
        if row not in known:
            known[row] = len(first)
            first.append(place)
        kind[place] = known[row]
    return np.array(first, int), kind
