"""Runs of one manoeuvre as tables of equal size: what was commanded, what was seen in each second, how it shook."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from auv_torchrl.diagnosis.alike.beginning import beginning, known_beginnings
from auv_torchrl.diagnosis.alike.spectrum import SHAKEN, highest_frequency, log_power
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.flightlog import Episode, FlightLog, FlightLogError
from auv_torchrl.flightlog.log import AXES
from auv_torchrl.physics import CONTROL_DT
from auv_torchrl.quantities import counted

BIN_S = 1.0  # s, over which samples become one number: slow enough for spikes to drop out, fast enough for a start
SHOWN = ("z", "u", "v", "w", "r")  # what runs are compared in; x and y depend on where and which way a run begins,
# and how a vehicle hangs, in roll and pitch, on ballast that is moved between one day and the next
FEWEST_BINS = 4
LONG_ENOUGH = 0.95  # of the median length: a run that was broken off shortens none of the others


@dataclass(frozen=True)
class Runs:
    """N runs of one manoeuvre, B bins of C channels each."""

    names: tuple[str, ...]
    session: np.ndarray  # (N,) number of the log that each comes from
    channels: tuple[str, ...]
    commands: Floats  # (N, S, n) each held for one control step
    seen: Floats  # (N, C, B) medians, in m, m/s, rad/s
    shaken: tuple[str, ...]  # A channels whose spectra are compared
    power: Floats  # (N, A, F) logarithms; NaN where samples are too few
    highest: float  # frequency of these, Hz
    known: tuple[str, ...]  # H numbers that are known of how a run begins
    begun: Floats  # (N, H) these, in rad and V; NaN where one was not measured
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
            seen=self.seen[rows],
            power=self.power[rows],
            begun=self.begun[rows],
            left_out=(),
        )


def cut_runs(logs: Sequence[FlightLog], sound: Runs | None = None) -> Runs:
    """The episodes of logs as runs; those that are too short are left out, and named.

    Args:
        logs: each is a session; each of its episodes is a run.
        sound: runs to compare them with, as long and in the same channels; None for as long as most of the runs are,
            in all that every log measures.

    Raises:
        FlightLogError: if too little is left to compare.
    """
    axes = [axis for axis in SHOWN if all(axis in log.axes for log in logs)]
    channels = sound.channels if sound else tuple(axes)
    if missing := sorted(set(channels) - set(axes)):
        raise FlightLogError(f"{', '.join(missing)} of the healthy runs is not in {logs[0].name}: log the same again")
    if not channels:
        raise FlightLogError(f"no log measures any of {', '.join(SHOWN)}: alike runs are compared in these")
    episodes = [episode for log in logs for episode in log.episodes]
    sessions = np.repeat(np.arange(len(logs)), [len(log.episodes) for log in logs])
    typical = float(np.median([episode.duration for episode in episodes]))
    bins = sound.seen.shape[-1] if sound else int(LONG_ENOUGH * typical / BIN_S)
    if bins < FEWEST_BINS:
        raise FlightLogError(f"the runs last {typical:.1f} s: {FEWEST_BINS * BIN_S / LONG_ENOUGH:.0f} s are needed")
    names = [e.source or f"{log.name}, episode {e.number}" for log in logs for e in log.episodes]
    tables = [_medians(episode, channels, bins) for episode in episodes]
    kept = [i for i, table in enumerate(tables) if table is not None]
    if not kept:
        raise FlightLogError(f"none of {counted(len(episodes), 'run')} has samples over {bins * BIN_S:.0f} s")
    shaken = tuple(name for name in SHAKEN if all(name in log.axes for log in logs))
    shaken, highest = (
        (sound.shaken, sound.highest) if sound else (shaken, highest_frequency([episodes[i] for i in kept]))
    )
    known = sound.known if sound else known_beginnings(logs)
    return Runs(
        tuple(names[i] for i in kept),
        sessions[kept],
        channels,
        np.stack([_held(episodes[i], round(bins * BIN_S / CONTROL_DT)) for i in kept]),
        np.stack([table for table in tables if table is not None]),
        shaken,
        np.stack([log_power(episodes[i], shaken, highest) for i in kept]),
        highest,
        known,
        np.stack([beginning(episodes[i], known) for i in kept]),
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
