"""A route at speed: from leg to leg along waypoints, steered by line of sight."""

# pyright: standard
# (the stubs of numpy do not know what unwrap returns)

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, Self

import numpy as np
from array_api_compat import array_namespace

from auv_torchrl.physics.kinematics import heading_of, quaternion_from_euler, quaternion_product
from auv_torchrl.settings import In
from auv_torchrl.tasks.cruise import Cruise, Steering
from auv_torchrl.tasks.curve import travelled
from auv_torchrl.tasks.shapes import rounded
from auv_torchrl.tasks.task import Reference
from auv_torchrl.tasks.waypoints import Coordinates

if TYPE_CHECKING:
    import torch
    from torch import Tensor

Array = Any
Floats = Any  # numpy, float64

_GRID_M = 0.25  # m between points of a path; the path is an arc from one to the next
_CHORD_M = 0.75  # m to both sides of a point, over which its heading is taken: longer than a corner of an arc
_SLOWEST = 0.1  # share of the speed, below which a course over ground is none


class Track:
    """A path at whose points headings and curvatures are known; open ones go on straight beyond their ends.

    Args:
        path: (k, 3) m, corners of a line; a closed one ends where it begins.
        closed: whether it is followed again and again.
    """

    def __init__(self, path: Floats, closed: bool):
        corners = travelled(path)
        self.length, self.closed = float(corners[-1]), closed
        count = max(2, round(self.length / _GRID_M))
        self.step = self.length / count
        where = np.arange(count + (not closed)) * self.step
        points = np.stack([np.interp(where, corners, path[:, axis]) for axis in range(3)], axis=-1)
        wide = max(1, round(_CHORD_M / self.step))
        chord = self._across(points, wide)
        heading = np.unwrap(np.arctan2(chord[:, 1], chord[:, 0]))
        bend = self._across(heading[:, None], wide)[:, 0]
        curvature = (bend - 2 * np.pi * np.round(bend / (2 * np.pi))) / (2 * wide * self.step)
        self.rows = np.concatenate((points, heading[:, None], curvature[:, None]), axis=1)
        self._tables: dict[Any, Array] = {}  # the same in other array libraries

    def _across(self, rows: Floats, wide: int) -> Floats:
        """Differences of rows (k, c) from as many before to as many behind each."""
        if self.closed:
            return np.roll(rows, -wide, axis=0) - np.roll(rows, wide, axis=0)
        before = rows[0] + (np.arange(-wide, 0)[:, None]) * (rows[1] - rows[0])
        behind = rows[-1] + (np.arange(1, wide + 1)[:, None]) * (rows[-1] - rows[-2])
        around = np.concatenate((before, rows, behind))
        return around[2 * wide :] - around[: -2 * wide]

    def at(self, distance: Array) -> Reference:
        """The point a distance (...) m along it."""
        xp = array_namespace(distance)
        last = len(self.rows) - 1
        number = xp.round(distance / self.step)
        beyond = distance - number * self.step
        if self.closed:
            return self._reference(xp.astype(xp.remainder(number, float(last + 1)), xp.int64), beyond)
        inside = xp.clip(number, 0.0, float(last))
        return self._reference(xp.astype(inside, xp.int64), beyond + (number - inside) * self.step)

    def foot(self, position: Array) -> Reference:
        """The point nearest to positions (..., 3), from above."""
        xp = array_namespace(position)
        rows = self._table(position)
        north, east = (position[..., axis, None] - rows[:, axis] for axis in range(2))
        number = xp.argmin(north * north + east * east, axis=-1)
        near = rows[number]
        ahead = position[..., :2] - near[..., :2]
        along = xp.cos(near[..., 3]) * ahead[..., 0] + xp.sin(near[..., 3]) * ahead[..., 1]
        return self._reference(number, self._limited(number, along))

    def curvature(self, position: Array) -> Array:
        """Of the nearest point to positions (..., 3), (...) rad/m."""
        xp = array_namespace(position)
        rows = self._table(position)
        north, east = (position[..., axis, None] - rows[:, axis] for axis in range(2))
        return rows[xp.argmin(north * north + east * east, axis=-1)][..., 4]

    def _limited(self, number: Array, along: Array) -> Array:
        """Distances (...) from points of the path, no further than half way to the next but at open ends."""
        xp = array_namespace(along)
        near, half = xp.clip(along, -self.step / 2, self.step / 2), along
        if self.closed:
            return near
        low, high = xp.minimum(half, near), xp.maximum(half, near)
        return xp.where(number == 0, low, xp.where(number == len(self.rows) - 1, high, near))

    def _reference(self, number: Array, beyond: Array) -> Reference:
        """Of distances (...) beyond points of the path."""
        xp = array_namespace(beyond)
        row = self._table(beyond)[number]
        course, zero = row[..., 3], xp.zeros_like(beyond)
        ahead = xp.stack((xp.cos(course), xp.sin(course), zero), axis=-1)
        yaw = course + row[..., 4] * beyond
        place = row[..., :3] + beyond[..., None] * ahead
        return Reference(place, quaternion_from_euler(zero, zero, yaw))

    def _table(self, like: Array) -> Array:
        key = (like.dtype, like.device)
        if key not in self._tables:
            self._tables[key] = array_namespace(like).asarray(self.rows, dtype=like.dtype, device=like.device)
        return self._tables[key]


@dataclass(frozen=True)
class Route(Cruise):
    """Follow waypoints at speed, through turns of a radius; a vehicle may be anywhere on the way.

    The heading to steer is that of the path, turned towards it by the angle under which a point some way ahead on it is
    seen across (line of sight, Fossen 2021, section 12.3), and a vehicle that slips aside steers by where it goes. The
    nearest point counts: a path that crosses itself is none to be followed.
    """

    name = "route"

    turn_rate: Annotated[float, In("(0, 10]")] | None = None  # rad/s, None: as fast as it can, to stay on the path
    north_m: Coordinates = (0.0, 60.0, 60.0, 0.0)  # m, of the points one after the other
    east_m: Coordinates = (0.0, 0.0, 60.0, 60.0)  # m
    down_m: Coordinates = (0.0, 0.0, 0.0, 0.0)  # m
    closed: bool = True  # from the last point to the first, again and again, from the middle of the first leg
    corner_m: Annotated[float, In("[0, 1000]")] = 15.0  # m, radius of the turns
    lookahead_m: Annotated[float, In("[0.1, 1000]")] = 6.0  # m ahead on the path, the point that is steered for
    anywhere: bool = True  # training episodes begin anywhere along the route, not only at its beginning

    def __post_init__(self) -> None:
        """Refuse values that no episode can have."""
        super().__post_init__()
        counts = [len(axis) for axis in (self.north_m, self.east_m, self.down_m)]
        if len(set(counts)) > 1 or counts[0] < 2 + self.closed:
            raise ValueError(
                f"task.north_m, task.east_m and task.down_m have {', '.join(map(str, counts))} entries: give one each "
                f"for every point, of {2 + self.closed} or more"
            )

    @cached_property
    def track(self) -> Track:
        """The path, drawn once."""
        points = np.stack((self.north_m, self.east_m, self.down_m), axis=1)
        path = _lap(points, self.corner_m) if self.closed else rounded(points.tolist(), self.corner_m, False)
        if not travelled(path)[-1] > _GRID_M:
            raise ValueError("the points of task.north_m and task.east_m are one: give a route that goes somewhere")
        return Track(path, self.closed)

    @property
    def farthest_start_m(self) -> float:
        """Along any axis, m."""
        return float(np.abs(self.track.rows[:, :3]).max()) + super().farthest_start_m

    def reference(self, time: Array) -> Reference:
        """A point that goes along the route at the speed."""
        xp = array_namespace(time)
        place = self.track.at(self.speed * time)
        zero, yaw = xp.zeros_like(time), place.yaw
        turning = self.speed * self.track.curvature(place.position)
        ahead = (self.speed * xp.cos(yaw), self.speed * xp.sin(yaw), zero, zero, zero, turning)
        floating = xp.asarray([False, False, not self.dives], device=time.device)
        return place._replace(velocity=xp.stack(ahead, axis=-1), free=floating, path=self.track)

    def steering(self, position: Array, quaternion: Array, velocity: Array) -> Steering:
        """What is off on the way to a point ahead on the route."""
        xp = array_namespace(position)
        foot = self.track.foot(position)
        course = foot.yaw
        away = position - foot.position
        across = xp.cos(course) * away[..., 1] - xp.sin(course) * away[..., 0]
        slip = xp.atan2(velocity[..., 1], xp.clip(velocity[..., 0], _SLOWEST * self.speed, None))
        heading = heading_of(quaternion) + slip - course + xp.atan2(across, xp.full_like(across, self.lookahead_m))
        depth = away[..., 2] if self.dives else xp.zeros_like(across)
        turning = self.speed * self.track.curvature(position) + self.turning_towards(heading)
        return Steering(heading, depth, across, turning)

    def draw_along(self, count: int, generator: "torch.Generator") -> "Tensor":
        """How far along the route episodes begin, (count,) s, float64."""
        import torch  # here, because the command line asks for the settings above

        share = torch.rand(count, generator=generator, dtype=torch.float64)
        return self.track.length / self.speed * (share if self.anywhere else torch.zeros_like(share))

    def draw_starts(
        self, count: int, generator: "torch.Generator", along: "Tensor | None" = None
    ) -> "tuple[Tensor, Tensor, Tensor]":
        """Position (count, 3), quaternion (count, 4) and body velocity (count, 6) of starts, float64."""
        import torch

        position, quaternion, velocity = super().draw_starts(count, generator)
        begun = torch.zeros(count, dtype=torch.float64) if along is None else along
        place = self.track.at(self.speed * begun)
        aside = self.box_m * (2 * torch.rand(count, generator=generator, dtype=torch.float64) - 1)
        yaw = place.yaw
        off = torch.stack((-torch.sin(yaw) * aside, torch.cos(yaw) * aside, position[:, 2]), dim=-1)
        return place.position + off, quaternion_product(place.quaternion, quaternion), velocity

    def for_evaluation(self, box_m: float | None) -> Self:
        """The same route from its beginning, with all starts within ``box_m`` in depth and to each side."""
        return replace(super().for_evaluation(box_m), anywhere=False)


def _lap(points: Floats, radius: float) -> Floats:
    """A closed line (k, 3) through points, each cut by an arc, from the middle of the first leg to there."""
    path = rounded(np.concatenate((points[-1:], points, points[:2])).tolist(), radius, False)
    corners, leg, middle = travelled(path), np.diff(path, axis=0), (points[0] + points[1]) / 2
    share = ((middle - path[:-1]) * leg).sum(-1) / np.maximum((leg * leg).sum(-1), 1e-12)
    share = np.clip(share, 0.0, 1.0)
    near = np.linalg.norm(path[:-1] + share[:, None] * leg - middle, axis=-1) < 1e-6
    passed = (corners[:-1] + share * np.diff(corners))[near]
    inside = path[(corners > passed.min() + 1e-9) & (corners < passed.max() - 1e-9)]
    return np.concatenate(([middle], inside, [middle]))
