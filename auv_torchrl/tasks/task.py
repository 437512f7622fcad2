"""What a task is: where a vehicle should be, what a policy sees of it, what is rewarded, how episodes start and end.

A task knows no simulator and no environment: pure functions of the state, batch first, on numpy or torch.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, Self

from array_api_compat import array_namespace

from auv_torchrl.physics.pace import CONTROL_DT
from auv_torchrl.settings import In

if TYPE_CHECKING:
    import torch
    from torch import Tensor

Array = Any


class Reference(NamedTuple):
    """Where a vehicle should be, earth NED."""

    position: Array  # (..., 3) m
    quaternion: Array  # (..., 4) w x y z, body to earth


@dataclass(frozen=True)
class Task(ABC):
    """Base of all tasks. A new one is a file and ``task/<name>.yaml``.

    The file lies beside this one, with an entry in ``TASKS``, or is ``tasks/*.py`` in a folder of one's own.
    """

    name: ClassVar[str]  # by which ``task=<name>`` chooses it

    episode_s: Annotated[float, In("(0, 3600]")] = 20.0  # s, section 5
    control_dt: Annotated[float, In("[0.001, 1]")] = CONTROL_DT  # s
    start_speed: Annotated[float, In("[0, 1000]")] = 2.0  # m/s, start velocities are uniform within this per axis
    start_yaw_rate: Annotated[float, In("[0, 1000]")] = 1.0  # rad/s, likewise
    tilt: bool = True  # observe roll and pitch motion: faults and weak restoring moments tilt the vehicle
    thruster_commands: bool = False  # actions are the n thruster commands themselves, not the four channels

    @property
    def steps(self) -> int:
        """Control steps per episode."""
        return round(self.episode_s / self.control_dt)

    @property
    @abstractmethod
    def observation_names(self) -> tuple[str, ...]:
        """What each entry of the observation is."""

    @property
    @abstractmethod
    def farthest_start_m(self) -> float:
        """Along any axis, m."""

    @abstractmethod
    def reference(self, time: Array) -> Reference:
        """Where vehicles should be at times (...) in s since their episodes began."""

    @abstractmethod
    def observe(self, position: Array, quaternion: Array, velocity: Array, time: Array) -> Array:
        """Observation (..., d) of measured position (..., 3), quaternion (..., 4) and body velocity (..., 6)."""

    @abstractmethod
    def reward(self, position: Array, quaternion: Array, velocity: Array, action: Array, time: Array) -> Array:
        """Reward (...) of the true state that an action (..., a) has led to."""

    @abstractmethod
    def draw_starts(self, count: int, generator: "torch.Generator") -> "tuple[Tensor, Tensor, Tensor]":
        """Position (count, 3), quaternion (count, 4) and body velocity (count, 6) of starts, float64."""

    @abstractmethod
    def for_evaluation(self, box_m: float | None) -> Self:
        """The same task with all starts uniform in a cube of half width ``box_m`` around the first reference.

        None takes the task's own cube.
        """

    def terminated(self, position: Array, quaternion: Array, velocity: Array, time: Array) -> Array:
        """Whether episodes (...) end before their time in such a true state; never, unless a task says so."""
        xp = array_namespace(position)
        return xp.zeros_like(position[..., 0], dtype=xp.bool)
