"""Tracking: follow a reference that moves along a curve, at a speed, with the curve's heading or north ahead."""

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from auv_torchrl.settings import Entries, In, OneOf
from auv_torchrl.tasks.curve import Curve, flown
from auv_torchrl.tasks.following import Travelling
from auv_torchrl.tasks.shapes import helix, lemniscate, parallel_lanes, rounded
from auv_torchrl.tasks.task import Reference

if TYPE_CHECKING:
    import torch
    from torch import Tensor

Array = Any
Floats = Any  # numpy, float64
Length = Annotated[float, In("[0.01, 1000]")]
Radius = Annotated[float, In("[0, 1000]")]
Speed = Annotated[float, In("[0.001, 10]")]


@dataclass(frozen=True)
class Tracking(Travelling):
    """A curve in time as the reference; a subclass says which."""

    speed: Speed = 0.3  # m/s along the curve
    acceleration: Annotated[float, In("[0.001, 100]")] = 0.1  # m/s^2, with which an open curve is begun and ended
    heading: Annotated[str, OneOf(("along", "held"))] = "along"  # the way the curve goes, or north
    roll: Annotated[float, In("[-1.5, 1.5]")] = 0.0  # rad, of the reference
    pitch: Annotated[float, In("[-1.5, 1.5]")] = 0.0  # rad, likewise
    attitude: bool = False  # follow roll and pitch too, for thruster commands: the channels cannot turn about these
    preview_s: Annotated[tuple[float, ...], In("[0.01, 60]"), Entries(0, 20)] = (
        0.25,
        0.5,
        1.0,
    )  # s, what is seen ahead

    def __post_init__(self) -> None:
        """Refuse values that no episode can have, and a curve that cannot be flown."""
        super().__post_init__()
        if (self.roll or self.pitch) and not self.attitude:
            raise ValueError("task.roll and task.pitch are followed with task.attitude=true: give that too")
        if self.attitude and not (self.tilt and self.thruster_commands):
            raise ValueError("task.attitude=true needs task.tilt=true and task.thruster_commands=true: give both")
        assert self.curve.duration > 0

    @abstractmethod
    def drawn(self) -> Curve:
        """The curve."""

    @cached_property
    def curve(self) -> Curve:
        """The curve, drawn once."""
        return self.drawn()

    def along_path(self, path: Floats, closed: bool) -> Curve:
        """A path (k, 3) m at the speed, from rest to rest where it is open."""
        return flown(path, self.pace(closed), closed, self.heading == "along", (self.roll, self.pitch))

    def pace(self, closed: bool) -> Any:
        """Speed by distance flown and length."""

        def speed(distance: Floats, length: float) -> Floats:
            if closed:
                return np.full(len(distance), self.speed)
            return np.minimum(self.speed, np.sqrt(2 * self.acceleration * np.minimum(distance, length - distance)))

        return speed

    @property
    def follows_attitude(self) -> bool:
        """Whether roll and pitch are followed too."""
        return self.attitude

    @property
    def ahead_s(self) -> tuple[float, ...]:
        """Up to when the coming motion of the reference is seen, s."""
        return self.preview_s

    @property
    def farthest_start_m(self) -> float:
        """Along any axis, m."""
        return self.curve.reach_m + super().farthest_start_m

    def reference(self, time: Array) -> Reference:
        """The curve at times (...)."""
        return self.curve.at(time)

    def draw_anywhere(self, count: int, generator: "torch.Generator") -> "Tensor":
        """Where on the curve episodes begin, (count,) s, float64."""
        import torch  # here, because the command line asks for the settings above

        return self.curve.duration * torch.rand(count, generator=generator, dtype=torch.float64)


@dataclass(frozen=True)
class Line(Tracking):
    """Straight north, and rest at its end."""

    name = "line"
    length_m: Length = 10.0  # m

    def drawn(self) -> Curve:
        """From the origin."""
        return self.along_path(np.array([[0.0, 0.0, 0.0], [self.length_m, 0.0, 0.0]]), closed=False)


@dataclass(frozen=True)
class Square(Tracking):
    """Around a square with rounded corners, clockwise from above."""

    name = "square"
    side_m: Length = 2.0  # m
    corner_m: Radius = 0.3  # m, radius of the corners

    def drawn(self) -> Curve:
        """Around the origin, from the middle of the western side."""
        half = self.side_m / 2
        corners = ((-half, -half, 0.0), (half, -half, 0.0), (half, half, 0.0), (-half, half, 0.0))
        return self.along_path(rounded(corners, self.corner_m, closed=True), closed=True)


@dataclass(frozen=True)
class Lawnmower(Tracking):
    """A survey: parallel lanes, one after the other."""

    name = "lawnmower"
    lane_m: Length = 3.0  # m, length of a lane
    spacing_m: Length = 1.0  # m, between lanes
    lanes: Annotated[int, In("[1, 1000]")] = 4
    corner_m: Radius = 0.3  # m, radius of the corners

    def drawn(self) -> Curve:
        """From the origin, north and east."""
        corners = parallel_lanes(self.lane_m, self.spacing_m, self.lanes)
        return self.along_path(rounded(corners, self.corner_m, closed=False), closed=False)


@dataclass(frozen=True)
class Lemniscate(Tracking):
    """A lying figure of eight, again and again."""

    name = "lemniscate"
    length_m: Length = 2.0  # m, north to south
    width_m: Length = 1.0  # m, east to west

    def drawn(self) -> Curve:
        """Around the origin, from its middle."""
        return self.along_path(lemniscate(self.length_m, self.width_m), closed=True)


@dataclass(frozen=True)
class Circle(Tracking):
    """A circle, clockwise from above, again and again."""

    name = "circle"
    radius_m: Length = 1.0  # m

    def drawn(self) -> Curve:
        """Around the origin, from north of it."""
        return self.along_path(helix(self.radius_m, 0.0, 1.0), closed=True)


@dataclass(frozen=True)
class Helix(Tracking):
    """Down in circles, and rest at its end."""

    name = "helix"
    radius_m: Length = 1.0  # m
    descent_m: Radius = 0.25  # m per turn
    turns: Annotated[float, In("[0.1, 1000]")] = 3.0

    def drawn(self) -> Curve:
        """Around the origin, from north of it."""
        return self.along_path(helix(self.radius_m, self.descent_m, self.turns), closed=False)


@dataclass(frozen=True)
class Docking(Tracking):
    """An approach straight north that is slow at its end, and rest in the dock."""

    name = "docking"
    distance_m: Length = 3.0  # m, from where it begins to the dock
    slow_m: Length = 0.8  # m before the dock, from where it is slow
    dock_speed: Speed = 0.05  # m/s, there

    def __post_init__(self) -> None:
        """Refuse an approach that is slow from the beginning."""
        super().__post_init__()
        if not (self.slow_m < self.distance_m and self.dock_speed <= self.speed):
            raise ValueError(
                f"task.slow_m is {self.slow_m:g} of {self.distance_m:g} m and task.dock_speed {self.dock_speed:g} of "
                f"{self.speed:g} m/s: give less than the whole way, and no more than the speed"
            )

    def drawn(self) -> Curve:
        """From the origin."""
        whole = self.pace(closed=False)

        def speed(distance: Floats, length: float) -> Floats:
            left = np.maximum(length - self.slow_m - distance, 0.0)  # m until it is to be slow
            return np.minimum(whole(distance, length), np.sqrt(self.dock_speed**2 + 2 * self.acceleration * left))

        path = np.array([[0.0, 0.0, 0.0], [self.distance_m, 0.0, 0.0]])
        return flown(path, speed, False, self.heading == "along", (self.roll, self.pitch))
