"""Fly vehicles with a pilot who sees what their sensors report, and keep what a log would hold."""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np

Pilot = Callable[[float, np.ndarray], np.ndarray]  # time in s and measured poses (N, 6) to thruster commands (N, n)


class Reported(Protocol):
    """What noiseless sensors report of N vehicles."""

    @property
    def pose(self) -> np.ndarray:
        """(N, 6) x, y, z in m, roll, pitch, yaw in rad."""
        ...

    @property
    def velocity(self) -> np.ndarray:
        """(N, 6) body velocity in m/s and rad/s."""
        ...


class Flown(Protocol):
    """Something that flies: a simulator on numpy, or what stands around one."""

    def report(self) -> Reported:
        """What its sensors report now."""
        ...

    def step(self, command: np.ndarray, /) -> Any:
        """Hold commands (N, n) for one control step."""
        ...


class Recorded(NamedTuple):
    """What was recorded of N vehicles at T times, one control step apart."""

    pose: np.ndarray  # (N, T, 6) as reported, before noise
    velocity: np.ndarray  # (N, T, 6) likewise
    measured: np.ndarray  # (N, T, 6) pose with noise, as the pilot saw it
    commands: np.ndarray  # (N, T, n) as sent, from each time on


def record(flown: Flown, pilot: Pilot, steps: int, control_dt: float, noise: np.ndarray | float = 0.0) -> Recorded:
    """Let a pilot fly for ``steps`` control steps.

    Args:
        flown: the vehicles, where they begin.
        pilot: gives the commands of each step.
        steps: T.
        control_dt: s between them.
        noise: (T, N, 6) of the pose, in m and rad, on top of what is reported.
    """
    added = np.broadcast_to(noise, (steps, *np.shape(noise)[1:]))
    kept = []
    for step in range(steps):
        reported = flown.report()
        measured = reported.pose + added[step]
        commands = pilot(step * control_dt, measured)
        kept.append((reported.pose, reported.velocity, measured, commands))
        flown.step(commands)
    return Recorded(*(np.stack(series, axis=1) for series in zip(*kept, strict=True)))
