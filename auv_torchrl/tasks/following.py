"""Tasks that follow a reference: what is seen of it, Eq. 6 of Lu et al. 2023 relative to it, starts around it."""

import math
from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, Self

from array_api_compat import array_namespace

from auv_torchrl.physics.kinematics import (
    heading_of,
    least_turn,
    matvec,
    quaternion_from_euler,
    rotation_matrix,
)
from auv_torchrl.settings import In, check_fields
from auv_torchrl.tasks.task import Reference, Task
from auv_torchrl.vehicle.fields import CONTROLLED

if TYPE_CHECKING:
    import torch
    from torch import Tensor

Array = Any
Weight = Annotated[float, In("[0, 1000]")]

_SENSED = ("surge_speed", "sway_speed", "heave_speed", "yaw_rate")
_ERROR = ("error_x", "error_y", "error_z", "heading_error_sin", "heading_error_cos")
_NEAR = ("near_x", "near_y", "near_z")
_TILT = ("roll_rate", "pitch_rate", "down_x", "down_y")


@dataclass(frozen=True)
class Following(Task):
    """What is observed and rewarded relative to a reference, and where episodes start; a subclass says the reference.

    Errors and speeds are those to the reference, along the axes of the body, so that the observation and with it the
    policy do not depend on where north is except through the heading error. Of the coming seconds it sees the mean
    speeds of the reference until then, which are 0 where it rests.

    Most of the training starts lie close to the reference, spread evenly over orders of magnitude, because a
    uniform box has almost none there and the last centimetres are what is judged.
    """

    box_m: Annotated[float, In("(0, 1000]")] = 10.0  # m, starts are uniform in a cube of this half width, section 5
    near_share: Annotated[float, In("[0, 1]")] = 0.75  # share of the starts at a log-uniform distance instead
    near_m: Annotated[tuple[float, float], In("(0, 1000]")] = (0.05, 2.0)  # m, range of that distance
    start_tilt: Annotated[float, In("[0, 3.2]")] = 0.0  # rad, start roll and pitch are uniform within this
    error_weight: Weight = 1.0  # 1/m, alpha_1 of Eq. 6
    heading_weight: Weight = 0.1  # 1/rad; the paper's error has no heading, so that it would drift
    velocity_weight: Weight = 0.05  # s/m, alpha_2 of Eq. 6
    action_weight: Weight = 0.005  # alpha_3 of Eq. 6, on the four channels in [-1, 1]
    near_scale_m: Annotated[float, In("(0, 1000]")] = 0.1  # m, of tanh(error / near_scale_m): 2 to 3 times faster

    def __post_init__(self) -> None:
        """Refuse values that no episode can have."""
        check_fields(self, "task")
        if not self.near_m[0] < self.near_m[1]:
            raise ValueError(f"task.near_m is {list(self.near_m)}: give two distances, 0 < low < high")

    @property
    def ahead_s(self) -> tuple[float, ...]:
        """Up to when the coming motion of the reference is seen, s, each as so many mean speeds."""
        return ()

    @property
    def follows_attitude(self) -> bool:
        """Whether roll and pitch of the reference are followed too; otherwise the vehicle may tilt as it likes."""
        return False

    @property
    def needs(self) -> tuple[str, ...]:
        """Degrees of freedom that a vehicle has to push: also roll and pitch, where these are followed."""
        return (*super().needs, *(("roll", "pitch") if self.follows_attitude else ()))

    @property
    def observation_names(self) -> tuple[str, ...]:
        """What each entry of the observation is."""
        coming = tuple(f"{name}_in_{seconds:g}_s" for seconds in self.ahead_s for name in CONTROLLED)
        return _SENSED + _ERROR + _NEAR + (_TILT if self.tilt else ()) + coming

    @property
    def farthest_start_m(self) -> float:
        """Along any axis, m."""
        return max(self.box_m, self.near_m[1] if self.near_share else 0.0)

    def for_evaluation(self, box_m: float | None) -> Self:
        """The same task with all starts uniform in a cube of half width ``box_m``; None takes the task's own."""
        return replace(self, box_m=box_m or self.box_m, near_share=0.0)

    def observe(self, position: Array, quaternion: Array, velocity: Array, time: Array) -> Array:
        """Observation (..., d) of measured position (..., 3), quaternion (..., 4) and body velocity (..., 6)."""
        xp = array_namespace(position, quaternion, velocity)
        reference = self.reference(time)
        to_body = rotation_matrix(quaternion).mT
        if self.follows_attitude:
            off = to_body @ rotation_matrix(reference.quaternion)
            heading, down = xp.atan2(off[..., 1, 0], off[..., 0, 0]), off[..., :2, 2]
        else:
            heading = reference.yaw - xp.atan2(to_body[..., 0, 1], to_body[..., 0, 0])
            down = to_body[..., :2, 2]
        error = matvec(to_body, reference.position - position)
        relative = velocity if reference.velocity is None else velocity - reference.moving(to_body)
        parts = [
            relative[..., :3],
            relative[..., 5:],
            error,
            xp.stack((xp.sin(heading), xp.cos(heading)), axis=-1),
            xp.tanh(error / self.near_scale_m),
        ]
        if self.tilt:
            parts += [relative[..., 3:5], down]
        if self.ahead_s:
            parts.append(self._coming(reference, to_body, time))
        return xp.concat(parts, axis=-1)

    def _coming(self, reference: Reference, to_body: Array, time: Array) -> Array:
        """Mean speeds (..., 4 k) of the reference, along the axes of the body as it is now, until each of k times."""
        xp = array_namespace(time)
        seconds = xp.asarray(self.ahead_s, dtype=time.dtype, device=time.device)
        then = self.reference(time[..., None] + seconds)
        moved = (then.position - reference.position[..., None, :]) @ to_body.mT
        turned = least_turn(then.yaw - reference.yaw[..., None])
        speeds = xp.concat((moved, turned[..., None]), axis=-1) / seconds[:, None]
        return xp.reshape(speeds, (*time.shape, -1))

    def reward(self, position: Array, quaternion: Array, velocity: Array, action: Array, time: Array) -> Array:
        """Eq. 6, (...): minus the weighted norms of error, velocity and control inputs, of the true state."""
        xp = array_namespace(position, quaternion, velocity)
        reference = self.reference(time)
        relative = velocity
        if reference.velocity is not None:
            relative = velocity - reference.moving(rotation_matrix(quaternion).mT)
        speed = xp.sqrt(xp.sum(relative[..., :3] ** 2, axis=-1) + relative[..., 5] ** 2)
        error = position - reference.position
        heading = xp.abs(least_turn(heading_of(quaternion) - reference.yaw))
        if self.follows_attitude:
            off = rotation_matrix(quaternion).mT @ rotation_matrix(reference.quaternion)
            down = off[..., :2, 2]
            heading = heading + xp.sqrt(xp.sum(down**2, axis=-1))
        return -(
            self.error_weight * xp.sqrt(xp.sum(error**2, axis=-1))
            + self.heading_weight * heading
            + self.velocity_weight * speed
            + self.action_weight * xp.sqrt(xp.sum(action**2, axis=-1))
        )

    def draw_starts(
        self, count: int, generator: "torch.Generator", along: "Tensor | None" = None
    ) -> "tuple[Tensor, Tensor, Tensor]":
        """Position (count, 3), quaternion (count, 4) and body velocity (count, 6) of starts, float64."""
        import torch  # here, because the command line asks for the settings above

        def uniform(*shape: int) -> "Tensor":
            return 2 * torch.rand(count, *shape, generator=generator, dtype=torch.float64) - 1

        position = self.box_m * uniform(3)
        low, high = (math.log(distance) for distance in self.near_m)
        distance = torch.exp(low + (high - low) * (uniform(1) + 1) / 2)
        direction = torch.nn.functional.normalize(
            torch.randn(count, 3, generator=generator, dtype=torch.float64), dim=-1
        )
        near = (uniform(1) + 1) / 2 < self.near_share
        position = torch.where(near, distance * direction, position)
        roll, pitch, yaw = (uniform(3) * torch.tensor((self.start_tilt, self.start_tilt, math.pi))).unbind(-1)
        scale = torch.tensor((*(self.start_speed,) * 3, 0.0, 0.0, self.start_yaw_rate))
        around = self.reference(torch.zeros(count, dtype=torch.float64) if along is None else along).position
        return around + position, quaternion_from_euler(roll, pitch, yaw), scale * uniform(6)


@dataclass(frozen=True)
class Travelling(Following):
    """Episodes of training begin anywhere along the task, those of an evaluation at its beginning."""

    anywhere: bool = True  # training episodes begin anywhere along the task, not only at its beginning

    @abstractmethod
    def draw_anywhere(self, count: int, generator: "torch.Generator") -> "Tensor":
        """Where on the whole way episodes begin, (count,) s along the task, float64."""

    def draw_along(self, count: int, generator: "torch.Generator") -> "Tensor":
        """How far along the task episodes begin, (count,) s, float64."""
        return self.draw_anywhere(count, generator) if self.anywhere else super().draw_along(count, generator)

    def for_evaluation(self, box_m: float | None) -> Self:
        """The same task from its beginning, with all starts uniform in a cube around the reference there."""
        return replace(super().for_evaluation(box_m), anywhere=False)


@dataclass(frozen=True)
class StationKeeping(Following):
    """Follow a reference that rests at the origin."""

    name = "station_keeping"
    compiles = True

    def reference(self, time: Array) -> Reference:
        """The origin, level, heading north, at rest, at all times (...)."""
        xp = array_namespace(time)
        return Reference.resting(xp.zeros((*time.shape, 3), dtype=time.dtype, device=time.device))
