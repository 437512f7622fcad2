"""Runs of one manoeuvre as tables of equal size: what was commanded, and what was seen in each second."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.flightlog import POSE, VELOCITY, Episode, FlightLog, FlightLogError
from auv_torchrl.physics import CONTROL_DT

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
            left_out=(),
        )


def cut_runs(logs: Sequence[FlightLog], bins: int | None = None, channels: Sequence[str] | None = None) -> Runs:
    """The episodes of logs as runs; those that are too short are left out, and named.

    Args:
        logs: each is a session; each of its episodes is a run.
        bins: how many seconds of each run; None for as many as most of the runs have.
        channels: what to compare; None for all that every log measures.

    Raises:
        FlightLogError: if too little is left to compare.
    """
    axes = [axis for axis in SHOWN if all(axis in log.axes for log in logs)]
    channels = tuple(axes if channels is None else channels)
    if missing := sorted(set(channels) - set(axes)):
        raise FlightLogError(f"{', '.join(missing)} of the healthy runs is not in {logs[0].name}: log the same again")
    if not channels:
        raise FlightLogError(f"no log measures any of {', '.join(SHOWN)}: alike runs are compared in these")
    episodes = [(number, log, episode) for number, log in enumerate(logs) for episode in log.episodes]
    typical = float(np.median([episode.duration for *_, episode in episodes]))
    bins = int(LONG_ENOUGH * typical / BIN_S) if bins is None else bins
    if bins < FEWEST_BINS:
        raise FlightLogError(f"the runs last {typical:.1f} s: {FEWEST_BINS * BIN_S / LONG_ENOUGH:.0f} s are needed")
    names, sessions, commands, seen, left_out = [], [], [], [], []
    for number, log, episode in episodes:
        name = episode.source or f"{log.name}, episode {episode.number}"
        table = _medians(episode, channels, bins)
        if table is None:
            left_out.append(name)
            continue
        names.append(name)
        sessions.append(number)
        commands.append(_held(episode, round(bins * BIN_S / CONTROL_DT)))
        seen.append(table)
    if not names:
        raise FlightLogError(f"none of {len(episodes)} runs has samples over {bins * BIN_S:.0f} s")
    return Runs(tuple(names), np.array(sessions), channels, np.stack(commands), np.stack(seen), tuple(left_out))


def _medians(episode: Episode, channels: Sequence[str], bins: int) -> Floats | None:
    """Medians (C, B) of a run, None where a bin has no sample."""
    columns = np.concatenate([episode.pose, episode.velocity], axis=1)
    columns = columns[:, [(POSE + VELOCITY).index(name) for name in channels]]
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
