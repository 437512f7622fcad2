"""Tasks: reference, observation, reward, starts and end; chosen by ``conf/task``."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, cast

from auv_torchrl.registry import Registry
from auv_torchrl.settings import choices
from auv_torchrl.tasks.cruise import Cruise
from auv_torchrl.tasks.following import Following, StationKeeping
from auv_torchrl.tasks.recorded import Recorded
from auv_torchrl.tasks.route import Route
from auv_torchrl.tasks.task import Reference, Task
from auv_torchrl.tasks.tracking import (
    Circle,
    Docking,
    Helix,
    Lawnmower,
    Lemniscate,
    Line,
    Square,
    Tracking,
)
from auv_torchrl.tasks.underway import cruise_speed, fitted
from auv_torchrl.tasks.waypoints import Waypoints

TASKS: Registry[type[Task]] = Registry(
    "tasks",
    Task,
    (StationKeeping, Waypoints, Line, Square, Lawnmower, Lemniscate, Circle, Helix, Recorded, Docking, Cruise, Route),
)

__all__ = [
    "TASKS",
    "Circle",
    "Cruise",
    "Docking",
    "Following",
    "Helix",
    "Lawnmower",
    "Lemniscate",
    "Line",
    "Recorded",
    "Reference",
    "Route",
    "Square",
    "StationKeeping",
    "Task",
    "Tracking",
    "Waypoints",
    "cruise_speed",
    "fitted",
    "read_task",
]


def read_task(settings: Mapping[str, Any] | None = None) -> Task:
    """A task from ``{name: station_keeping, ...}`` as in ``conf/task/*.yaml``; what is left out has its default.

    Raises:
        ValueError: for an unknown name or setting, naming those there are, or a value that cannot be.
    """
    settings = {"name": StationKeeping.name, **(settings or {})}
    name = settings.pop("name")
    if name not in TASKS:
        raise ValueError(f"no task named {name!r}: {choices([name], TASKS)}")
    kind: Any = TASKS[name]
    known = [entry.name for entry in fields(kind)]
    if unknown := sorted(set(settings) - set(known)):
        raise ValueError(f"task {name} has no {', '.join(unknown)}: {choices(unknown, known)}")
    lists = {key: tuple(cast(list[Any], value)) for key, value in settings.items() if isinstance(value, list)}
    return kind(**{**settings, **lists})
