"""Runs of one manoeuvre as tables of equal size: commands, medians of each second, spectra, and how each run begins.

Healthy runs depend on what is measured before the vehicle pushes. Ballast that is moved between one day and the next
tilts a vehicle at rest, and then the vehicle dives and turns otherwise; a fuller battery pushes more. Neither is a
fault, and no fault of what pushes shows there.

A spectrum is that of the first difference of a rate, which takes out most of the slope that such spectra have. Sine
tapers (Riedel and Sidorenko 1995) use all of a short run with little leakage from one frequency to another.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.flightlog import POSE, Episode, FlightLog, FlightLogError
from auv_torchrl.flightlog.log import AXES
from auv_torchrl.physics import CONTROL_DT
from auv_torchrl.quantities import counted

BIN_S = 1.0  # s, over which samples become one number: slow enough for spikes to drop out, fast enough for a start
# What runs are compared in. x and y depend on where and which way a run begins; roll and pitch depend on ballast that
# is moved between one day and the next.
COMPARED = ("z", "u", "v", "w", "r")
FEWEST_BINS = 4
LONG_ENOUGH = 0.95  # of the median length: a run that was broken off shortens none of the others

TILTS = ("roll", "pitch")
VOLTS = "volts"
LONGEST_S = 1.0  # s, that count as the beginning where a run is left alone for longer

GYRO_AXES = ("p", "q", "r")  # a propeller shakes the gyros once a turn; measured speeds are too slow for that
GRID_HZ = 0.05  # several values for each frequency that a run of ten seconds tells apart
TAPERS = 5  # of a run of ten seconds, which they smooth over a third of a hertz to both sides
DRIFT = 4  # order of the polynomial of time that the motion itself is taken for
GLITCH = 4.0  # typical deviations beyond which a sample of a gyro is none
SETS_OFF_S = 1.0  # s from the start of a run: a leap is in every frequency
FEWEST_SAMPLES = 0.9  # of those that a run should have


@dataclass(frozen=True)
class Runs:
    """N runs of one manoeuvre, B bins of C channels each."""

    names: tuple[str, ...]
    session: np.ndarray  # (N,) number of the log that each comes from
    channels: tuple[str, ...]
    commands: Floats  # (N, S, n) each held for one control step
    medians: Floats  # (N, C, B) in m, m/s, rad/s
    gyro_axes: tuple[str, ...]  # A channels whose spectra are compared
    power: Floats  # (N, A, F) logarithms; NaN where samples are too few
    highest: float  # frequency of these, Hz
    beginning_names: tuple[str, ...]  # H numbers that are known of how every run begins
    beginnings: Floats  # (N, H) these, in rad and V; NaN where one was not measured
    left_out: tuple[str, ...] = ()  # runs that are too short, or lack samples

    def __len__(self) -> int:
        return len(self.names)

    def some(self, rows: Sequence[int] | np.ndarray) -> "Runs":
        """A part of the runs."""
        rows = np.asarray(rows)
        return replace(
            self,
            names=tuple(self.names[row] for row in rows.tolist()),
            session=self.session[rows],
            commands=self.commands[rows],
            medians=self.medians[rows],
            power=self.power[rows],
            beginnings=self.beginnings[rows],
            left_out=(),
        )


def cut_runs(logs: Sequence[FlightLog], healthy: Runs | None = None) -> Runs:
    """The episodes of logs as runs; those that are too short are left out, and named.

    Args:
        logs: each is a session; each of its episodes is a run.
        healthy: runs to compare them with, as long and in the same channels; None for as long as most of the runs are,
            in all that every log measures.

    Raises:
        FlightLogError: if too little is left to compare.
    """
    axes = [axis for axis in COMPARED if all(axis in log.axes for log in logs)]
    channels = healthy.channels if healthy else tuple(axes)
    if missing := sorted(set(channels) - set(axes)):
        raise FlightLogError(f"{', '.join(missing)} of the healthy runs is not in {logs[0].name}: log the same again")
    if not channels:
        raise FlightLogError(f"no log measures any of {', '.join(COMPARED)}: alike runs are compared in these")
    episodes = [episode for log in logs for episode in log.episodes]
    sessions = np.repeat(np.arange(len(logs)), [len(log.episodes) for log in logs])
    typical = float(np.median([episode.duration for episode in episodes]))
    bins = healthy.medians.shape[-1] if healthy else int(LONG_ENOUGH * typical / BIN_S)
    if bins < FEWEST_BINS:
        raise FlightLogError(f"the runs last {typical:.1f} s: {FEWEST_BINS * BIN_S / LONG_ENOUGH:.0f} s are needed")
    names = [e.source or f"{log.name}, episode {e.number}" for log in logs for e in log.episodes]
    tables = [_medians(episode, channels, bins) for episode in episodes]
    usable = [i for i, table in enumerate(tables) if table is not None]
    if not usable:
        raise FlightLogError(f"none of {counted(len(episodes), 'run')} has samples over {bins * BIN_S:.0f} s")
    if healthy:
        gyro_axes, highest, beginning_names = healthy.gyro_axes, healthy.highest, healthy.beginning_names
    else:
        gyro_axes = tuple(name for name in GYRO_AXES if all(name in log.axes for log in logs))
        highest = highest_frequency([episodes[i] for i in usable])
        beginning_names = measured_beginnings(logs)
    return Runs(
        tuple(names[i] for i in usable),
        sessions[usable],
        channels,
        np.stack([_held(episodes[i], round(bins * BIN_S / CONTROL_DT)) for i in usable]),
        np.stack([table for table in tables if table is not None]),
        gyro_axes,
        np.stack([log_power(episodes[i], gyro_axes, highest) for i in usable]),
        highest,
        beginning_names,
        np.stack([beginning(episodes[i], beginning_names) for i in usable]),
        tuple(name for name, table in zip(names, tables, strict=True) if table is None),
    )


def _medians(episode: Episode, channels: Sequence[str], bins: int) -> Floats | None:
    """Medians (C, B) of a run, None where a bin has no sample."""
    columns = episode.values[:, [AXES.index(name) for name in channels]]
    place = np.floor((episode.t - episode.t[0]) / BIN_S).astype(int)
    found = np.full((len(channels), bins), np.nan)
    for at in range(bins):
        rows = columns[place == at]
        if not len(rows) or not np.isfinite(rows).any(0).all():
            return None
        found[:, at] = np.nanmedian(rows, axis=0)
    return found


def _held(episode: Episode, steps: int) -> Floats:
    """Commands (steps, n) at control steps from the first sample on."""
    at = np.searchsorted(episode.t - episode.t[0], np.arange(steps) * CONTROL_DT + 1e-9, side="right") - 1
    return episode.commands[np.clip(at, 0, len(episode.commands) - 1)]


def measured_beginnings(logs: Sequence[FlightLog]) -> tuple[str, ...]:
    """What is measured at the beginning of every run of these logs."""
    tilts = [name for name in TILTS if all(name in log.axes for log in logs)]
    fed = all(episode.battery is not None for log in logs for episode in log.episodes)
    return (*tilts, VOLTS) if fed else tuple(tilts)


def beginning(episode: Episode, names: Sequence[str]) -> Floats:
    """Medians (H,) in rad and V, before the commands first change; NaN where nothing is measured."""
    changes = np.flatnonzero((np.diff(episode.commands, axis=0) != 0).any(1))
    still = episode.t - episode.t[0] <= LONGEST_S
    still[changes[0] + 1 if len(changes) else len(still) :] = False
    found = []
    for name in names:
        column = episode.battery if name == VOLTS else episode.pose[:, POSE.index(name)]
        own = np.full(len(still), np.nan) if column is None else column
        own = own[still & np.isfinite(own)]
        found.append(float(np.median(own)) if len(own) else np.nan)
    return np.array(found)


def highest_frequency(episodes: Sequence[Episode]) -> float:
    """Half the rate of sampling of the slowest of the episodes, Hz."""
    return min(0.5 / _step(episode) for episode in episodes)


def log_power(episode: Episode, channels: Sequence[str], highest: float) -> Floats:
    """Logarithm (A, F) of the power per hertz of the change of each channel; NaN where samples are too few.

    Args:
        episode: one run.
        channels: A of :data:`GYRO_AXES`.
        highest: frequency in Hz; F are from 0 up to it by :data:`GRID_HZ`.
    """
    frequencies = np.arange(0.0, highest, GRID_HZ)
    step = _step(episode)
    if 0.5 / step < 0.99 * highest:
        return np.full((len(channels), len(frequencies)), np.nan)
    columns = episode.values[:, [AXES.index(name) for name in channels]]
    since = episode.t - episode.t[0]
    even = np.arange(SETS_OFF_S, since[-1], step)
    return np.array([_log_power(since, column, even, frequencies) for column in columns.T]).reshape(
        len(channels), len(frequencies)
    )


def _log_power(t: Floats, values: Floats, even: Floats, frequencies: Floats) -> Floats:
    seen = np.isfinite(values) & (t >= even[0])
    if seen.sum() < FEWEST_SAMPLES * len(even):
        return np.full(len(frequencies), np.nan)
    typical = np.median(np.abs(values[seen] - np.median(values[seen])))
    middle, reach = np.median(values[seen]), GLITCH * 1.4826 * typical  # of a normal distribution's deviation
    step = even[1] - even[0]
    change = np.diff(np.clip(np.interp(even, t[seen], values[seen]), middle - reach, middle + reach)) / step
    count, place = len(change), np.linspace(-1.0, 1.0, len(change))
    left = change - np.polyval(np.polyfit(place, change, DRIFT), place)
    order = np.arange(1, TAPERS + 1)[:, None]
    tapers = np.sqrt(2.0 / (count + 1)) * np.sin(np.pi * order * np.arange(1, count + 1) / (count + 1))
    waves = np.exp(-2j * np.pi * frequencies[:, None] * np.arange(count) * step)
    power = (np.abs((tapers * left) @ waves.T) ** 2).mean(0) * step
    return np.log(power + np.finfo(float).tiny)


def _step(episode: Episode) -> float:
    return float(np.median(np.diff(episode.t)))
