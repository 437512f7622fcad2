"""Velocities that an instrument mixes: one that is turned reports some of v in u, one off the origin feels p, q, r."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from auv_torchrl.physics.kinematics import matvec
from auv_torchrl.sensors.sensor import MOTION

Floats = np.ndarray[Any, np.dtype[Any]]


@dataclass(frozen=True)
class Mixing:
    """What is reported of linear velocities, where some of the vehicles (R,) report them mixed."""

    rows: Floats  # (R, 3, 6) reported u, v, w per unit of each true number of the velocity

    @staticmethod
    def of(slopes: Floats, speed: Floats, channels: tuple[str, ...]) -> "Mixing | None":
        """Of ``slopes`` (R, 12, 12) of reports, in logs of some channels; None where no vehicle mixes any.

        An axis whose place is logged, or that is not logged, has the true ``speed`` (R, 3) over the reported one. One
        that is not logged, but mixed with one that is, is what the instrument would have reported of it.
        """
        own = slopes[:, 6:9, 6:]
        velocity, place = (np.array([name in channels for name in names]) for names in (MOTION[6:9], MOTION[:3]))
        mixed = linked(slopes)
        taken = (velocity & ~place) | (mixed & (mixed & velocity).any(1, keepdims=True))
        rows = np.where(taken[..., None], own, np.eye(3, 6) / speed[:, :, None])
        return Mixing(rows) if _beside_diagonal(rows).any() else None

    def each(self, change: Callable[[Floats], Floats]) -> "Mixing":
        """The same of the rows that ``change`` makes of these."""
        return Mixing(change(self.rows))

    def reported(self, linear: Floats, angular: Floats, unmixed: Floats) -> Floats:
        """Reports (..., 3) of velocities, or of accelerations; ``unmixed`` of the vehicles that do not mix them."""
        mixed = matvec(self.rows[..., :3], linear) + matvec(self.rows[..., 3:], angular)
        return np.where(self._mixes, mixed, unmixed)

    def true(self, linear: Floats, angular: Floats, unmixed: Floats) -> Floats:
        """The inverse of :meth:`reported` at the same turning of the body."""
        mixed = matvec(np.linalg.inv(self.rows[..., :3]), linear - matvec(self.rows[..., 3:], angular))
        return np.where(self._mixes, mixed, unmixed)

    @property
    def _mixes(self) -> np.ndarray:
        return np.asarray(_beside_diagonal(self.rows).any((-2, -1)))[..., None]


def linked(slopes: Floats) -> np.ndarray:
    """Whether reports of each linear velocity have some of others in them, (R, 3), of ``slopes`` (R, 12, 12)."""
    beside = _beside_diagonal(slopes[:, 6:9, 6:])[..., :3]
    return np.asarray(beside.any(1) | beside.any(2))


def _beside_diagonal(rows: Floats) -> np.ndarray:
    """Where numbers (..., 3, 6) beside the diagonal are not 0."""
    return np.asarray((rows != 0) & ~np.eye(3, 6, dtype=bool))
