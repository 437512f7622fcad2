"""A flight log in memory: what a vehicle was commanded and how it moved, episode by episode.

Frames: earth NED, body FRD, angles in radians (ZYX). All arrays are numpy float64.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from auv_torchrl.flightlog.findings import Finding, FlightLogError, Severity
from auv_torchrl.sensors import FELT, MOTION

POSE = MOTION[:6]  # m, rad
VELOCITY = MOTION[6:]  # m/s, rad/s, body
ACCELERATION = FELT  # m/s^2, body: specific force, on the mean over the time around a row
AXES = POSE + VELOCITY + ACCELERATION
ANGLES = ("roll", "pitch", "yaw")

Floats = NDArray[np.float64]
IDLE = 0.07  # of full command, below which no thruster turns: the dead band of speed controllers, 1472 to 1528 us
ALONE = "one_episode"  # code of the finding that no longer holds when logs are joined


@dataclass(frozen=True)
class SampleErrors:
    """What a log says of its errors, where they are more than white noise on every sample."""

    snapshot_s: float = 0.0  # s between snapshots of commands that change faster; 0 where commands are held
    drift: Mapping[str, float] = field(default_factory=dict[str, float])  # m/s, rad/s: how fast estimates go astray

    @property
    def coloured(self) -> bool:
        """Whether there is more than white noise."""
        return self.snapshot_s > 0 or any(rate > 0 for rate in self.drift.values())

    def __or__(self, other: "SampleErrors") -> "SampleErrors":
        """The worse of two logs."""
        axes = {**self.drift, **other.drift}
        worse = {axis: max(self.drift.get(axis, 0.0), other.drift.get(axis, 0.0)) for axis in axes}
        return SampleErrors(max(self.snapshot_s, other.snapshot_s), worse)


@dataclass(frozen=True)
class Episode:
    """An uninterrupted stretch of a log; ``T`` samples at times that need not be regular.

    Row k holds the pose and velocity measured at ``t[k]`` and the command that acts from ``t[k]`` to ``t[k + 1]``.
    """

    number: int  # unique within a log
    t: Floats  # (T,) s since the start of the episode; a part behind a gap keeps its time
    pose: Floats  # (T, 6) x y z roll pitch yaw; a column of NaN where not measured
    velocity: Floats  # (T, 6) u v w p q r; a column of NaN where not measured
    commands: Floats  # (T, n) thruster commands in [-1, 1], after mixer and clip
    battery: Floats | None = None  # (T,) V
    source: str = ""  # file and episode in it, for people
    filled: Floats | None = None  # (T, 12), or 15 with accelerations: 1 where filled in, not measured; None: nowhere
    parts: Floats | None = None  # (T, P, n) commands in P equal parts of the time to the next row; None: they are held
    acceleration: Floats | None = None  # (T, 3) ax ay az; a column of NaN, or None for all of them, where not measured

    def __len__(self) -> int:
        return len(self.t)

    @property
    def duration(self) -> float:
        """Seconds from the first to the last sample."""
        return float(self.t[-1] - self.t[0])

    @property
    def values(self) -> Floats:
        """All axes (T, 15) side by side; a column of NaN where not measured."""
        felt = np.full((len(self), len(ACCELERATION)), np.nan) if self.acceleration is None else self.acceleration
        return np.concatenate([self.pose, self.velocity, felt], axis=1)

    def rows(self, start: int, stop: int) -> "Episode":
        """The samples ``start`` to ``stop - 1`` as an episode of its own."""
        some = {name: getattr(self, name) for name in ("battery", "filled", "parts", "acceleration")}
        return replace(
            self,
            t=self.t[start:stop],
            pose=self.pose[start:stop],
            velocity=self.velocity[start:stop],
            commands=self.commands[start:stop],
            **{name: None if whole is None else whole[start:stop] for name, whole in some.items()},
        )


@dataclass(frozen=True)
class FlightLog:
    """Episodes of one vehicle with the same measured axes."""

    name: str
    episodes: tuple[Episode, ...]
    axes: tuple[str, ...]  # measured, out of AXES
    findings: tuple[Finding, ...] = field(default=())
    resolution: dict[str, float] = field(default_factory=dict[str, float])  # step in which an axis is written, if known
    errors: SampleErrors = SampleErrors()
    autopilot: Mapping[str, float] = field(default_factory=dict[str, float])  # its parameters, where the log has them

    @property
    def duration(self) -> float:
        """Seconds of data."""
        return sum(episode.duration for episode in self.episodes)

    @property
    def samples(self) -> int:
        """Number of rows over all episodes."""
        return sum(len(episode) for episode in self.episodes)

    @property
    def is_idle(self) -> bool:
        """Whether no thruster turns."""
        return all(float(np.abs(episode.commands).max(initial=0.0)) < IDLE for episode in self.episodes)

    @property
    def thrusters(self) -> int:
        """Number of thrusters commanded."""
        return self.episodes[0].commands.shape[1]

    def only(self, numbers: Iterable[int]) -> "FlightLog":
        """The log with these episodes alone, in its own order."""
        wanted = set(numbers)
        return replace(self, episodes=tuple(e for e in self.episodes if e.number in wanted))


def join(logs: Iterable[FlightLog]) -> FlightLog:
    """Several logs of one vehicle as one, episodes numbered anew; axes that not all of them have are left out.

    Raises:
        FlightLogError: for no log at all, different numbers of thrusters, or no axis in common.
    """
    logs = list(logs)
    if not logs:
        raise FlightLogError("no log to join: give at least one")
    if len(logs) == 1:
        return logs[0]
    counts = {log.name: log.thrusters for log in logs}
    if len(set(counts.values())) > 1:
        raise FlightLogError(f"the logs command different numbers of thrusters {counts}: give logs of one vehicle")
    axes = tuple(axis for axis in AXES if all(axis in log.axes for log in logs))
    if not axes:
        raise FlightLogError(f"the logs {', '.join(counts)} measure no axis in common: diagnose them one by one")
    findings = [
        replace(f, sentence=f"{log.name}: {f.sentence}") for log in logs for f in log.findings if f.code != ALONE
    ]
    if lost := {axis for log in logs for axis in log.axes} - set(axes):
        names = tuple(axis for axis in AXES if axis in lost)
        sentence = f"left out because not every log measures them: {', '.join(names)}"
        findings.append(Finding(Severity.WARNING, "axes_left_out", sentence, columns=names))
    episodes = [episode for log in logs for episode in log.episodes]
    episodes = [replace(with_axes(episode, axes), number=number) for number, episode in enumerate(episodes)]
    resolution = {axis: max(log.resolution.get(axis, 0.0) for log in logs) for axis in axes}
    errors = reduce(SampleErrors.__or__, (log.errors for log in logs))
    first, *others = (log.autopilot for log in logs)
    autopilot = {name: value for name, value in first.items() if all(other.get(name) == value for other in others)}
    return FlightLog(", ".join(counts), tuple(episodes), axes, tuple(findings), resolution, errors, autopilot)


def with_axes(episode: Episode, axes: tuple[str, ...]) -> Episode:
    """The episode with all other axes unmeasured."""
    pose = np.where([axis in axes for axis in POSE], episode.pose, np.nan)
    velocity = np.where([axis in axes for axis in VELOCITY], episode.velocity, np.nan)
    felt = None
    if episode.acceleration is not None and set(axes) & set(ACCELERATION):
        felt = np.where([axis in axes for axis in ACCELERATION], episode.acceleration, np.nan)
    return replace(episode, pose=pose, velocity=velocity, acceleration=felt)
