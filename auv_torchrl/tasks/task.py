"""What a task is: where a vehicle should be, what a policy sees of it, what is rewarded, how episodes start and end.

A task knows no simulator and no environment: pure functions of the state, batch first, on numpy or torch.
"""

from abc import ABC, abstractmethod
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, Self

from array_api_compat import array_namespace

from auv_torchrl.physics.kinematics import heading_of, matvec
from auv_torchrl.physics.pace import CONTROL_DT
from auv_torchrl.settings import In
from auv_torchrl.vehicle.fields import CONTROLLED

if TYPE_CHECKING:
    import torch
    from torch import Tensor

Array = Any


class Reference(NamedTuple):
    """Where a vehicle should be and how fast it should move, earth NED."""

    position: Array  # (..., 3) m
    quaternion: Array  # (..., 4) w x y z, body to earth
    velocity: Array = None  # (..., 6) m/s and rad/s, along the axes of the earth; None for one that rests
    heading: Array = None  # (...) rad, where it is known without the quaternion
    free: Array = None  # (3,) bool, coordinates in which any position will do; None for none
    path: Any = None  # of which any point will do, with a method ``foot``; None where only the one of the time will

    @classmethod
    def resting(cls, position: Array) -> Self:
        """At positions (..., 3) m, level, heading north, at rest."""
        xp = array_namespace(position)
        level = xp.zeros((*position.shape[:-1], 4), dtype=position.dtype, device=position.device)
        level[..., 0] = 1.0
        return cls(position, level, heading=xp.zeros_like(level[..., 0]))

    @property
    def yaw(self) -> Array:
        """Its heading (...) in rad."""
        return heading_of(self.quaternion) if self.heading is None else self.heading

    def nearest(self, position: Array) -> Array:
        """Where a vehicle at a position (..., 3) should be, m: along free coordinates or a path where it is."""
        wanted = self.position if self.path is None else self.path.foot(position).position
        return wanted if self.free is None else array_namespace(position).where(self.free, position, wanted)

    def attitude(self, position: Array) -> Array:
        """Quaternion (..., 4) that a vehicle at a position (..., 3) should have: along a path where it is."""
        return self.quaternion if self.path is None else self.path.foot(position).quaternion

    def moving(self, to_body: Array) -> Array:
        """Its velocity (..., 6) along axes that ``to_body`` (..., 3, 3) turns those of the earth to; 0 if it rests."""
        if self.velocity is None:
            return 0.0
        xp = array_namespace(self.velocity)
        linear, angular = self.velocity[..., :3], self.velocity[..., 3:]
        return xp.concat((matvec(to_body, linear), matvec(to_body, angular)), axis=-1)


@dataclass(frozen=True)
class Task(ABC):
    """Base of all tasks. A new one is a file and ``task/<name>.yaml``.

    The file lies beside this one, with an entry in ``TASKS``, or is ``tasks/*.py`` in a folder of one's own. ``time``
    is how far along the task a vehicle is, s: since its episode began, and what it began with or has skipped.
    """

    name: ClassVar[str]  # by which ``task=<name>`` chooses it
    compiles: ClassVar[bool] = False  # whether what a class observes and rewards is a straight line of arithmetic

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
    def axes(self) -> tuple[str, ...]:
        """Degrees of freedom that an action commands, one entry each, through the mixer of the vehicle."""
        return CONTROLLED

    @property
    def needs(self) -> tuple[str, ...]:
        """Degrees of freedom that a vehicle has to push, each by itself and both ways."""
        return self.axes

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
        """Where vehicles should be that are ``time`` (...) s along the task."""

    def miss(self, position: Array, quaternion: Array, velocity: Array, time: Array) -> Array:
        """How far off vehicles are, (...) m, by which the best policy is chosen: how far from where they should be."""
        wanted = self.reference(time).nearest(position)
        return array_namespace(position).linalg.vector_norm(position - wanted, axis=-1)

    @abstractmethod
    def observe(self, position: Array, quaternion: Array, velocity: Array, time: Array) -> Array:
        """Observation (..., d) of measured position (..., 3), quaternion (..., 4) and body velocity (..., 6)."""

    @abstractmethod
    def reward(self, position: Array, quaternion: Array, velocity: Array, action: Array, time: Array) -> Array:
        """Reward (...) of the true state that an action (..., a) has led to."""

    @abstractmethod
    def draw_starts(
        self, count: int, generator: "torch.Generator", along: "Tensor | None" = None
    ) -> "tuple[Tensor, Tensor, Tensor]":
        """Position (count, 3), quaternion (count, 4) and body velocity (count, 6) of starts, float64.

        They lie around the reference ``along`` (count,) s along the task; None is its beginning.
        """

    def draw_along(self, count: int, generator: "torch.Generator") -> "Tensor":
        """How far along the task episodes begin, (count,) s, float64: at its beginning, unless a task says so."""
        import torch  # here, because the command line asks for the settings above

        return torch.zeros(count, dtype=torch.float64)

    def skipped(self, position: Array, quaternion: Array, velocity: Array, time: Array) -> Array | None:
        """By how many s (...) vehicles that are measured there go on at once; None where a task never does that."""
        return None

    def described(self) -> dict[str, Any]:
        """What a policy that is trained on the task depends on, as plain values.

        Station keeping has no name here, so that policies that were kept before there were other tasks are found.
        """
        return {**asdict(self), **({} if self.name == "station_keeping" else {"name": self.name})}

    @abstractmethod
    def for_evaluation(self, box_m: float | None) -> Self:
        """The same task with all starts uniform in a cube of half width ``box_m`` around the first reference.

        None takes the task's own cube.
        """

    def terminated(self, position: Array, quaternion: Array, velocity: Array, time: Array) -> Array:
        """Whether episodes (...) end before their time in such a true state; never, unless a task says so."""
        xp = array_namespace(position)
        return xp.zeros_like(position[..., 0], dtype=xp.bool)
