"""Tasks at speed, for vehicles that steer by turning: a torpedo, a surface vessel."""

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Self

from auv_torchrl.settings import Entries, OneOf
from auv_torchrl.tasks.task import Task
from auv_torchrl.vehicle.fields import DEGREES_OF_FREEDOM

if TYPE_CHECKING:
    from auv_torchrl.vehicle import Vehicle

_VERTICAL = ("heave", "pitch")  # the first that a vehicle has keeps its depth
_TORPEDO = ("surge", "pitch", "yaw")


@dataclass(frozen=True)
class Underway(Task):
    """A task that surge and yaw suffice for, with heave or pitch where the vehicle dives."""

    controlled: Annotated[tuple[str, ...], OneOf(DEGREES_OF_FREEDOM), Entries(0, 6)] = ()  # axes; none: by the vehicle

    @property
    def axes(self) -> tuple[str, ...]:
        """Degrees of freedom that an action commands; those of a torpedo where no vehicle is known yet."""
        return self.controlled or _TORPEDO

    @property
    @abstractmethod
    def cruise_speed(self) -> float:
        """Speed ahead in m/s at which axes are controlled, because fins need a flow."""

    @property
    def dives(self) -> bool:
        """Whether depth is controlled at all."""
        return any(axis in self.axes for axis in _VERTICAL)

    def fitted(self, vehicle: "Vehicle") -> Self:
        """The task with the axes that the mixer of a vehicle (empty batch) has: surge, heave or pitch, yaw."""
        if self.controlled:
            return self
        moved = [axis for axis, column in zip(DEGREES_OF_FREEDOM, vehicle.mixer.T, strict=True) if (column != 0).any()]
        vertical = [axis for axis in _VERTICAL if axis in moved][:1]
        wanted = ("surge", *vertical, "yaw")
        return replace(self, controlled=tuple(axis for axis in wanted if axis in moved) or wanted)


def fitted(task: Task, vehicle: "Vehicle") -> Task:
    """The task for a vehicle (empty batch): where axes follow from the vehicle, with its axes."""
    return task.fitted(vehicle) if isinstance(task, Underway) else task


def cruise_speed(task: Task) -> float:
    """Speed ahead in m/s at which a vehicle is controlled; 0 of one that hovers."""
    return task.cruise_speed if isinstance(task, Underway) else 0.0
