"""A flight log as streams: what was commanded and what each sensor said, each at the times at which it was taken.

Frames: earth NED, body FRD, SI units, angles in radians (ZYX). Times are seconds since the start of the log.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import groupby
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auv_torchrl.flightlog.findings import Finding
from auv_torchrl.text import printable

Floats = NDArray[np.float64]
Spans = tuple[tuple[float, float], ...]  # s, from and to
Modes = tuple[tuple[float, str], ...]  # s, since when which

LONG_PAUSE = 5.0  # usual sampling intervals; what is longer is a gap,
LONG_PAUSE_S = 0.3  # if it is also longer than this
WHICH_COMMANDS = "which_commands"  # code of findings about what may be the commands of the thrusters
DAMAGED = "damaged_description"  # code of findings about messages that are left out because their form is not known


class Sampling(StrEnum):
    """How the samples of a stream stand for what was between them."""

    MEASURED = "measured"  # by a sensor, at that moment
    ESTIMATED = "estimated"  # by a filter, whose errors are coloured and agree with those of its other estimates
    HELD = "held"  # a command that stays as it is until the next sample
    SNAPSHOT = "snapshot"  # of a command that changes faster than it is logged: held, it would be half a step late


@dataclass(frozen=True)
class Stream:
    """Samples of one source, whose name is made printable. Times rise strictly; a value that was not given is NaN."""

    name: str
    channels: tuple[str, ...]
    units: tuple[str, ...]  # of the channels
    t: Floats  # (T,) s
    values: Floats  # (T, channels)
    sampling: Sampling
    source: str  # where in the file, for people
    drift: float | None = None  # of an estimate: standard deviation of the rate of its error, per s; None is not said

    def __post_init__(self) -> None:
        object.__setattr__(self, "source", printable(self.source))

    def __len__(self) -> int:
        return len(self.t)

    @property
    def interval(self) -> float:
        """The usual time between samples in s; NaN for fewer than two."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else np.nan

    @property
    def rate(self) -> str:
        """How often there is a sample, for people."""
        return f"{1 / self.interval:.3g} Hz" if len(self.t) > 1 else "once"

    @property
    def pause(self) -> float:
        """The time in s beyond which samples are no neighbours; NaN for fewer than two."""
        return max(LONG_PAUSE * self.interval, LONG_PAUSE_S) if len(self.t) > 1 else np.nan

    @property
    def gaps(self) -> Spans:
        """Where samples are missing."""
        wide = np.flatnonzero(np.diff(self.t) > self.pause)
        return tuple((float(self.t[i]), float(self.t[i + 1])) for i in wide)


def stream(
    name: str,
    channels: Iterable[str],
    units: str | tuple[str, ...],
    t: ArrayLike,
    values: ArrayLike,
    sampling: Sampling,
    source: str,
    drift: float | None = None,
) -> Stream | None:
    """A stream from samples in any order; None if nothing of them can be used.

    Args:
        name: of the stream.
        channels: names of what is sampled.
        units: of the channels, or the one that all have.
        t: (T,) s; samples without a time, and all but the first of one time, are left out.
        values: (T, channels), NaN where nothing was given.
        sampling: how samples stand for what was between them.
        source: where in the file, for people.
        drift: how fast the error of an estimate changes, per s; None where the file does not say.
    """
    channels = tuple(channels)
    units = (units,) * len(channels) if isinstance(units, str) else units
    t = np.asarray(t, np.float64)
    values = np.asarray(values, np.float64).reshape(len(t), len(channels))
    finite = np.isfinite(t) & np.isfinite(values).any(axis=-1)
    t, values = t[finite], values[finite]
    if np.any(np.diff(t) <= 0):
        t, first = np.unique(t, return_index=True)
        values = values[first]
    return Stream(name, channels, units, t, values, sampling, source, drift) if len(t) else None


class Kind(NamedTuple):
    """A kind of vehicle as one thing in a file names it."""

    source: str  # what names it, such as "text of the firmware"
    name: str  # such as "ArduCopter" or "a quadrotor"
    underwater: bool


@dataclass(frozen=True)
class VehicleFacts:
    """What a log says about the vehicle; empty or None where it says nothing. Its texts are made printable."""

    firmware: str = ""
    frame: str = ""
    motors: int | None = None  # thrusters of the frame
    parameters: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    kinds: tuple[Kind, ...] = ()  # of vehicle, by each thing that names one

    def __post_init__(self) -> None:
        object.__setattr__(self, "firmware", printable(self.firmware))
        object.__setattr__(self, "frame", printable(self.frame))


@dataclass(frozen=True)
class Streams:
    """Everything that was read from one file. Its name and its modes are made printable."""

    name: str
    format: str
    streams: Mapping[str, Stream]
    vehicle: VehicleFacts = VehicleFacts()
    armed: Spans | None = None  # None where the file does not say
    modes: Modes = ()  # since when which; what is before the first is not known
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", printable(self.name))
        object.__setattr__(self, "modes", tuple((t, printable(mode)) for t, mode in self.modes))

    @property
    def start(self) -> float:
        """The first sample of any stream, s."""
        return min((float(s.t[0]) for s in self.streams.values()), default=0.0)

    @property
    def end(self) -> float:
        """The last sample of any stream, s."""
        return max((float(s.t[-1]) for s in self.streams.values()), default=0.0)

    def mode_spans(self) -> tuple[tuple[float, float, str], ...]:
        """From when to when which mode was flown."""
        ends = [t for t, _ in self.modes[1:]] + [max(self.end, self.modes[-1][0])] if self.modes else []
        return tuple((t, end, mode) for (t, mode), end in zip(self.modes, ends, strict=True))


@dataclass(frozen=True)
class Place:
    """Where one channel is found: a column, or a field of a message; ``data.3`` is the fourth number of an array."""

    name: str
    sign: float


@dataclass(frozen=True)
class MappedStream:
    """One stream as its owner describes it."""

    name: str
    channels: tuple[str, ...]
    places: tuple[Place, ...]  # of the channels
    topic: str  # empty for a table
    unit: str  # of the stream
    scale: float  # a channel is sign * (scale * number + offset), in the unit of the stream
    offset: float
    sampling: Sampling

    def converted(self, numbers: Floats) -> Floats:
        """Channels (T, n) in the unit of the stream from the numbers (T, n) of the file."""
        return np.array([place.sign for place in self.places]) * (self.scale * numbers + self.offset)


@dataclass(frozen=True)
class ReadOptions:
    """What people add to a file."""

    modes: tuple[str, ...] = ()  # to take alone; empty takes all
    parameters: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))  # that the file lacks
    system: int | None = None  # which vehicle of several
    mapping: tuple[MappedStream, ...] = ()  # what columns or fields stand for; empty where the format says it
    findings: tuple[Finding, ...] = ()  # about what they gave


def by_name(found: Iterable[Stream | None]) -> dict[str, Stream]:
    """Streams that are there, by name."""
    return {stream.name: stream for stream in found if stream is not None}


def state_of(rows: Iterable[tuple[float, bool, str]], end: float) -> tuple[Spans | None, Modes]:
    """When a vehicle was armed, and since when in which mode, where time, arming and mode are told again and again."""
    rows = list(rows)
    modes = tuple(next((t, mode) for t, _, mode in same) for _, same in groupby(rows, key=lambda row: row[2]))
    return spans_of([(t, on) for t, on, _ in rows], end, events=False), modes


def spans_of(changes: list[tuple[float, bool]], end: float, events: bool = True) -> Spans | None:
    """From when to when a state held, which was told when it changed; None if it never was told.

    Where ``events`` are told, a first one that ends the state says that it held before.
    """
    if not changes:
        return None
    spans: list[tuple[float, float]] = []
    since = 0.0 if events and not changes[0][1] else None
    for t, on in changes:
        if on and since is None:
            since = t
        elif not on and since is not None:
            spans += [(since, t)] if t > since else []
            since = None
    return tuple(spans) if since is None else (*spans, (since, max(end, since)))
