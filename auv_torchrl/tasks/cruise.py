"""Cruise: hold a speed, a depth and a heading, wherever that leads."""

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, Self

from array_api_compat import array_namespace

from auv_torchrl.physics.kinematics import heading_of, least_turn, quaternion_from_euler, rotation_matrix
from auv_torchrl.settings import In, check_fields
from auv_torchrl.tasks.task import Reference
from auv_torchrl.tasks.underway import Underway

if TYPE_CHECKING:
    import torch
    from torch import Tensor

Array = Any
Weight = Annotated[float, In("[0, 1000]")]

_SURFACE = ("surge_speed_error", "sway_speed", "turning_error", "heading_error_sin", "heading_error_cos")
_DEPTH = ("heave_speed", "far_z", "near_z")
_TILT = ("roll_rate", "pitch_rate", "down_x", "down_y")


class Steering(NamedTuple):
    """What is off, (...) each."""

    heading: Array  # rad, of the one that is wanted, any number of turns beside
    depth: Array  # m
    across: Array  # m, the way of a path; 0 where there is none
    turning: Array  # rad/s, that is wanted


@dataclass(frozen=True)
class Cruise(Underway):
    """Hold speed and heading, and the depth where the vehicle dives; north and east are free.

    Depths and headings are errors to those that are wanted, so that a policy holds any. Starts lie off in both, and
    the vehicle is already under way: fins do nothing without a flow.
    """

    name = "cruise"

    episode_s: Annotated[float, In("(0, 3600]")] = 30.0  # s
    start_speed: Annotated[float, In("[0, 1000]")] = 0.1  # m/s, sway and heave at the start are uniform within this
    start_yaw_rate: Annotated[float, In("[0, 1000]")] = 0.05  # rad/s, roll, pitch and yaw rates likewise
    speed: Annotated[float, In("[0.001, 10]")] = 1.5  # m/s ahead, through the water
    speed_spread: Annotated[float, In("[0, 1)")] = 0.3  # share by which speeds at the start differ from it
    box_m: Annotated[float, In("(0, 1000]")] = 4.0  # m, depths at the start are uniform within this
    near_share: Annotated[float, In("[0, 1]")] = 0.5  # share of the starts at a log-uniform depth and heading instead
    near_m: Annotated[tuple[float, float], In("(0, 1000]")] = (0.02, 2.0)  # m, range of that depth
    start_heading: Annotated[float, In("[0, 3.2]")] = 1.0  # rad, headings at the start are uniform within this
    start_tilt: Annotated[float, In("[0, 1.5]")] = 0.1  # rad, start roll and pitch are uniform within this
    ahead_s: Annotated[float, In("[0, 100]")] = 2.0  # s, rewarded depths are those in so long a time, as it now sinks
    steepest: Annotated[float, In("(0, 1.5]")] = 0.3  # rad, at which it is to sink or rise where it is far off
    turn_rate: Annotated[float, In("(0, 10]")] | None = 0.1  # rad/s, with which it is to turn where it is far off: by
    # the speed 15 m of radius, which a torpedo can end with one rudder out of two; None: as fast as it can
    turn_s: Annotated[float, In("(0, 100]")] = 2.0  # s, in which the last of the error of heading is to fall to 37 %
    depth_weight: Weight = 1.0  # 1/m
    heading_weight: Weight = 1.0  # 1/rad
    speed_weight: Weight = 0.5  # s/m
    turning_weight: Weight = 0.1  # s/rad, on roll, pitch and yaw rates
    action_weight: Weight = 0.005  # on the channels in [-1, 1]
    near_scale_m: Annotated[float, In("(0, 1000]")] = 0.2  # m, of tanh(error / near_scale_m)

    def __post_init__(self) -> None:
        """Refuse values that no episode can have."""
        check_fields(self, "task")
        if not self.near_m[0] < self.near_m[1]:
            raise ValueError(f"task.near_m is {list(self.near_m)}: give two depths, 0 < low < high")

    @property
    def cruise_speed(self) -> float:
        """The speed, m/s."""
        return self.speed

    @property
    def observation_names(self) -> tuple[str, ...]:
        """What each entry of the observation is."""
        return _SURFACE + (_DEPTH if self.dives else ()) + (_TILT if self.tilt else ())

    @property
    def farthest_start_m(self) -> float:
        """Along any axis, m."""
        return max(self.box_m, self.near_m[1] if self.near_share else 0.0)

    def reference(self, time: Array) -> Reference:
        """A point that goes north at the speed, level, at depth 0."""
        xp = array_namespace(time)
        resting = Reference.resting(xp.zeros((*time.shape, 3), dtype=time.dtype, device=time.device))
        zero = xp.zeros_like(time)
        position = xp.stack((self.speed * time, zero, zero), axis=-1)
        velocity = xp.stack((zero + self.speed, zero, zero, zero, zero, zero), axis=-1)
        anywhere = xp.asarray([True, True, not self.dives], device=time.device)
        return resting._replace(position=position, velocity=velocity, free=anywhere)

    def steering(self, position: Array, quaternion: Array, velocity: Array) -> Steering:
        """What is off in a depth and a heading that stay the same."""
        xp = array_namespace(position)
        zero = xp.zeros_like(position[..., 2])
        heading = heading_of(quaternion)
        return Steering(heading, position[..., 2] if self.dives else zero, zero, self.turning_towards(heading))

    def turning_towards(self, heading: Array) -> Array:
        """Yaw rate (...) in rad/s that is wanted at errors of heading (...) in rad."""
        xp = array_namespace(heading)
        if self.turn_rate is None:
            return xp.zeros_like(heading)
        return -self.turn_rate * xp.tanh(least_turn(heading) / (self.turn_s * self.turn_rate))

    def miss(self, position: Array, quaternion: Array, velocity: Array, time: Array) -> Array:
        """Depth error, a metre for each radian of the heading error, and half a metre for each m/s of speed."""
        xp, off = array_namespace(position), self.steering(position, quaternion, velocity)
        turned = xp.abs(least_turn(off.heading)) + xp.abs(off.across)
        return xp.abs(off.depth) + turned + 0.5 * xp.abs(velocity[..., 0] - self.speed)

    def observe(self, position: Array, quaternion: Array, velocity: Array, time: Array) -> Array:
        """Observation (..., d) of measured position (..., 3), quaternion (..., 4) and body velocity (..., 6)."""
        xp = array_namespace(position, quaternion, velocity)
        rotation, off = rotation_matrix(quaternion), self.steering(position, quaternion, velocity)
        turning = (velocity[..., 5] - off.turning) / (self.turn_rate or 1.0)  # of order 1, as other entries
        parts = [velocity[..., 0] - self.speed, velocity[..., 1], turning, xp.sin(-off.heading), xp.cos(off.heading)]
        if self.dives:
            error = -off.depth
            parts += [velocity[..., 2], xp.tanh(error), xp.tanh(error / self.near_scale_m)]
        if self.tilt:
            parts += [velocity[..., 3], velocity[..., 4], rotation[..., 2, 0], rotation[..., 2, 1]]
        return xp.stack(parts, axis=-1)

    def reward(self, position: Array, quaternion: Array, velocity: Array, action: Array, time: Array) -> Array:
        """Minus the weighted errors of depth, heading and speed, the turning, and the norm of the action, (...).

        The depth is the one in ``ahead_s``, as the vehicle now sinks: without an error the true one falls with that
        time constant. A depth shows what fins do seconds later, and at first the other way.
        """
        xp = array_namespace(position, quaternion, velocity)
        off = self.steering(position, quaternion, velocity)
        rates = xp.concat((velocity[..., 3:5], (velocity[..., 5] - off.turning)[..., None]), axis=-1)
        turning = xp.sqrt(xp.sum(rates**2, axis=-1) + 1e-12) - 1e-6  # with a slope at rest
        return -(
            self.depth_weight * xp.abs(self._expected_depth(off.depth, quaternion, velocity))
            + self.heading_weight * self._off_heading(off, velocity)
            + self.speed_weight * xp.abs(velocity[..., 0] - self.speed)
            + self.turning_weight * turning
            + self.action_weight * xp.sqrt(xp.sum(action**2, axis=-1))
        )

    def _off_heading(self, off: Steering, velocity: Array) -> Array:
        """Error (...) of heading in rad, or what a wrong yaw rate makes of it in ``turn_s``."""
        xp = array_namespace(velocity)
        if self.turn_rate is None:
            return xp.abs(least_turn(off.heading))
        return self.turn_s * xp.abs(velocity[..., 5] - off.turning)

    def _expected_depth(self, depth: Array, quaternion: Array, velocity: Array) -> Array:
        """Error (...) of depth in m that is expected; far off one as large as what is sunk at the steepest."""
        xp = array_namespace(depth, quaternion, velocity)
        if not self.dives or not self.ahead_s:
            return depth
        most = self.ahead_s * self.speed * math.sin(self.steepest)
        sinking = xp.sum(rotation_matrix(quaternion)[..., 2, :] * velocity[..., :3], axis=-1)
        return most * xp.tanh(depth / most) + self.ahead_s * sinking

    def draw_starts(
        self, count: int, generator: "torch.Generator", along: "Tensor | None" = None
    ) -> "tuple[Tensor, Tensor, Tensor]":
        """Position (count, 3), quaternion (count, 4) and body velocity (count, 6) of starts, float64."""
        import torch  # here, because the command line asks for the settings above

        def uniform() -> "Tensor":
            return 2 * torch.rand(count, generator=generator, dtype=torch.float64) - 1

        depth, heading = self.box_m * uniform(), self.start_heading * uniform()
        low, high = (math.log(distance) for distance in self.near_m)
        distance = torch.exp(low + (high - low) * (uniform() + 1) / 2)
        near = (uniform() + 1) / 2 < self.near_share
        depth = torch.where(near, distance * uniform().sign(), depth)
        heading = torch.where(near, heading * distance / self.near_m[1], heading)
        zero = torch.zeros_like(depth)
        roll, pitch = self.start_tilt * uniform(), self.start_tilt * uniform()
        if not self.dives:
            depth = zero
        ahead = self.speed * (1 + self.speed_spread * uniform())
        sideways, down = self.start_speed * uniform(), self.start_speed * uniform()
        rates = [self.start_yaw_rate * uniform() for _ in range(3)]
        velocity = torch.stack((ahead, sideways, down, *rates), dim=-1)
        return torch.stack((zero, zero, depth), dim=-1), quaternion_from_euler(roll, pitch, heading), velocity

    def for_evaluation(self, box_m: float | None) -> Self:
        """The same task with all starts at depths within ``box_m``; None takes the task's own."""
        return replace(self, box_m=box_m or self.box_m, near_share=0.0)
