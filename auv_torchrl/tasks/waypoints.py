"""Waypoints: from point to point, on to the next within a radius of one, as autopilots do."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from array_api_compat import array_namespace

from auv_torchrl.settings import Entries, In
from auv_torchrl.tasks.following import Travelling
from auv_torchrl.tasks.task import Reference

if TYPE_CHECKING:
    import torch
    from torch import Tensor

Array = Any
Coordinates = Annotated[tuple[float, ...], In("[-1000, 1000]"), Entries(1, 1000)]

_BEYOND_S = 1e-3  # s, how far into the time of the next point one goes, so that rounding does not bring one back


@dataclass(frozen=True)
class Waypoints(Travelling):
    """Follow a reference that rests at one point after the other, heading north.

    Each point has ``patience_s`` of the task's time: who is within the radius before skips the rest of it, who is
    not by then goes on all the same. The last point is held.
    """

    name = "waypoints"
    north_m: Coordinates = (0.0, 2.0, 2.0, 0.0)  # m, of the points one after the other
    east_m: Coordinates = (0.0, 0.0, 2.0, 2.0)  # m
    down_m: Coordinates = (0.0, 0.0, 0.5, 0.5)  # m
    radius_m: Annotated[float, In("[0.001, 1000]")] = 0.2  # m, that is near enough to go on
    patience_s: Annotated[float, In("[1, 3600]")] = 15.0  # s, after which one goes on from a point not reached

    def __post_init__(self) -> None:
        """Refuse values that no episode can have."""
        super().__post_init__()
        counts = [len(axis) for axis in (self.north_m, self.east_m, self.down_m)]
        if len(set(counts)) > 1:
            raise ValueError(
                f"task.north_m, task.east_m and task.down_m have {', '.join(map(str, counts))} entries: give one each "
                "for every point"
            )

    @property
    def points(self) -> Array:
        """(k, 3) m."""
        return np.stack((self.north_m, self.east_m, self.down_m), axis=1)

    @property
    def farthest_start_m(self) -> float:
        """Along any axis, m."""
        return float(np.abs(self.points).max()) + super().farthest_start_m

    def reference(self, time: Array) -> Reference:
        """The point whose time it is, level, heading north, at rest."""
        xp = array_namespace(time)
        points = xp.asarray(self.points, dtype=time.dtype, device=time.device)
        return Reference.resting(points[self._number(time)])

    def skipped(self, position: Array, quaternion: Array, velocity: Array, time: Array) -> Array:
        """The rest of the time of a point that is reached, (...) s."""
        xp = array_namespace(position)
        number = self._number(time)
        near = xp.sqrt(xp.sum((position - self.reference(time).position) ** 2, axis=-1)) < self.radius_m
        rest = (xp.astype(number, time.dtype) + 1) * self.patience_s + _BEYOND_S - time
        return xp.where(near & (number < len(self.north_m) - 1), rest, xp.zeros_like(time))

    def draw_anywhere(self, count: int, generator: "torch.Generator") -> "Tensor":
        """At which point episodes begin, (count,) s, float64."""
        import torch  # here, because the command line asks for the settings above

        number = torch.randint(len(self.north_m), (count,), generator=generator)
        return self.patience_s * number.double() + _BEYOND_S

    def _number(self, time: Array) -> Array:
        """Of the point whose time it is, (...)."""
        xp = array_namespace(time)
        last = len(self.north_m) - 1
        return xp.clip(xp.astype(xp.floor(time / self.patience_s), xp.int64), 0, last)
