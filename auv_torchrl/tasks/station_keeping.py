"""Station keeping: bring the vehicle to the origin with heading north and hold it there (Lu et al. 2023, Problem 1)."""

from dataclasses import dataclass
from typing import Any

from array_api_compat import array_namespace

from auv_torchrl.tasks.following import Following
from auv_torchrl.tasks.task import Reference

Array = Any


@dataclass(frozen=True)
class StationKeeping(Following):
    """Follow a reference that rests at the origin."""

    name = "station_keeping"
    compiles = True

    def reference(self, time: Array) -> Reference:
        """The origin, level, heading north, at rest, at all times (...)."""
        xp = array_namespace(time)
        return Reference.resting(xp.zeros((*time.shape, 3), dtype=time.dtype, device=time.device))
