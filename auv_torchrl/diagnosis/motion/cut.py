"""A flight log cut into windows."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from auv_torchrl.diagnosis.motion.windows import Floats, Windows, affordable, guess_starts
from auv_torchrl.diagnosis.thresholds import MAX_WINDOWS, STEEP
from auv_torchrl.flightlog import Episode, FlightLog, FlightLogError
from auv_torchrl.flightlog.log import ANGLES
from auv_torchrl.physics import CONTROL_DT
from auv_torchrl.sensors import CHANNELS, FELT, MOTION

# Of a target step, by which grid steps may be longer: clocks of vehicles are off by as much, and a third step in each
# row for one microsecond makes all that is simulated half as long again.
UNEVEN = 0.1


class _Cut(NamedTuple):
    """One window as it is cut out of an episode."""

    order: int  # of the episode, among those of the log
    episode: Episode
    start: int  # grid step
    position: Floats  # (m,) grid steps behind the start at which samples are
    values: Floats  # (m, 15)
    trusted: Floats  # (m, 15)


def cut_windows(log: FlightLog, window_s: float, lead_s: float, bin_s: float = 0.0) -> Windows:
    """Windows of ``window_s`` seconds, end to end, without the first ``lead_s`` seconds of each episode.

    The lead is left out because commands before the first row are not logged. With ``bin_s``, the length of a window is
    a whole number of pairs of bins of that many seconds.

    Raises:
        FlightLogError: if no episode holds a window.
    """
    dt, merged = grid_step(log)
    within = max([merged, *(episode.parts.shape[1] for episode in log.episodes if episode.parts is not None)])
    pair, lead = 2 * max(1, round(bin_s / dt)), round(lead_s / dt)
    steps = pair * max(1, round(window_s / (pair * dt))) if bin_s else max(4, round(window_s / dt))
    channels = tuple(axis for axis in CHANNELS if axis in log.axes)
    columns = [CHANNELS.index(channel) for channel in channels]
    grids, cuts = [], []
    for order, episode in enumerate(log.episodes):
        t, values, trusted = _merge(episode, merged)
        length = int(np.floor((t[-1] - episode.t[0]) / dt + 1e-6)) + 1
        grids.append(_commands_on_grid(episode, dt / within, length * within).reshape(length, within, -1))
        position, known = (t - episode.t[0]) / dt, np.asarray(trusted[:, columns].any(1))
        first = _first_seen(position, known, lead) if log.errors.snapshot_s else lead
        starts = range(first, length - steps + 1, steps)
        for start, inside, seen in _dense(position, known, starts, dt, max(0.5, 0.25 * window_s)):
            inside = seen if log.errors.snapshot_s else inside  # a row with a command alone has no sample
            cuts.append(_Cut(order, episode, start, position[inside] - start, values[inside], trusted[inside]))
    if not cuts:
        raise FlightLogError(
            f"{log.name}: no episode holds a window of {window_s:g} s behind the first {lead_s:g} s: give a longer log"
        )
    many, most = len(cuts), min(MAX_WINDOWS, _affordable(log, cuts, channels, steps, round(bin_s / dt)))
    if many > most:
        cuts = [cuts[i] for i in np.linspace(0, many - 1, most).astype(int)]
    longest = max(len(grid) for grid in grids)
    parts = np.stack([np.pad(grid, ((0, longest - len(grid)), (0, 0), (0, 0)), mode="edge") for grid in grids])
    windows = Windows(
        dt=dt,
        steps=steps,
        channels=channels,
        commands=parts.mean(2),
        parts=parts if np.ptp(parts, axis=2).any() else None,
        episode=np.array([cut.order for cut in cuts]),
        number=np.array([cut.episode.number for cut in cuts]),
        start=np.array([cut.start for cut in cuts]),
        origin=np.array([cut.episode.t[0] for cut in cuts]),
        resolution=np.array([log.resolution.get(channel, 0.0) for channel in channels]),
        guess=guess_starts([cut.position * dt for cut in cuts], [cut.values[:, : len(MOTION)] for cut in cuts]),
        errors=log.errors,
        volts=_volts(log, dt, longest),
        share=len(cuts) / many,
        around=max(1, round(merged * _row_s(log) / dt)) / 2,
        **_samples(cuts, columns),
    )
    return windows.without_edges()


def _affordable(log: FlightLog, cuts: list[_Cut], channels: tuple[str, ...], steps: int, per_bin: int) -> int:
    """How many windows fit the memory with a force per half a bin in each, as a limit cycle needs.

    All of them fit where windows have no force (``per_bin`` is 0). A degree of freedom without a channel has none.
    """
    if not per_bin:
        return len(cuts)
    axes = sum(bool({*MOTION[d::6], *FELT[d : d + 1]} & set(channels)) for d in range(6))
    samples = max(len(cut.position) for cut in cuts)
    free = len(MOTION) + axes * -(-steps // max(1, per_bin // 2))
    return affordable(samples * len(channels), free, log.errors.coloured)


def _volts(log: FlightLog, dt: float, length: int) -> Floats | None:
    """Volts (E, length) at grid steps, between the samples of each episode; NaN where it has none."""
    found = np.full((len(log.episodes), length), np.nan)
    for row, episode in zip(found, log.episodes, strict=True):
        if episode.battery is not None and (logged := np.isfinite(episode.battery)).any():
            row[:] = np.interp(episode.t[0] + dt * np.arange(length), episode.t[logged], episode.battery[logged])
    return None if np.isnan(found).all() else found


def _dense(
    position: Floats, known: np.ndarray, starts: range, dt: float, pause_s: float
) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Windows of an episode without a pause longer than ``pause_s``: grid step, their rows, those with a sample."""
    for start in starts:
        end = start + starts.step
        inside = np.flatnonzero((position > start - 1e-6) & (position < end - 1e-6))
        seen = inside[known[inside]]
        ends = np.concatenate([[start], position[seen], [end]])
        if len(seen) >= 4 and np.diff(ends).max() * dt <= pause_s:
            yield start, inside, seen


def _samples(cuts: list[_Cut], columns: list[int]) -> dict[str, np.ndarray]:
    """The samples of windows side by side, as many columns as the fullest has; what is missing has no trust."""
    shape = (len(cuts), max(len(cut.position) for cut in cuts))
    index, fraction, present = np.zeros(shape, int), np.zeros(shape), np.zeros(shape, bool)
    measured, trust = (np.zeros((*shape, len(columns))) for _ in range(2))
    for w, cut in enumerate(cuts):
        k = len(cut.position)
        whole = np.floor(cut.position + 1e-6).astype(int)
        behind = cut.position - whole
        index[w, :k], fraction[w, :k], present[w, :k] = whole, np.where(behind < 1e-3, 0.0, behind), True
        measured[w, :k], trust[w, :k] = cut.values[:, columns], cut.trusted[:, columns]
    return {"index": index, "fraction": fraction, "present": present, "measured": measured, "trust": trust}


def _trust_upright(values: Floats) -> Floats:
    """Trust (T,) in roll and yaw of samples (T, 15): errors of the attitude show in them 1 / cos(pitch) as large."""
    pitch = values[:, CHANNELS.index("pitch")]
    return np.where(np.abs(pitch) > STEEP, 0.0, np.where(np.isnan(pitch), 1.0, np.cos(pitch)))


def _first_seen(position: Floats, known: np.ndarray, lead: int) -> int:
    """The grid step of the first sample behind the lead, where a window can begin with what was measured."""
    behind = position[known & (position > lead - 0.5)]
    return round(float(behind[0])) if len(behind) else lead


def grid_step(log: FlightLog) -> tuple[float, int]:
    """Grid step in s, near the control step, and how many samples are averaged into one (1 unless sampled fast)."""
    sample = _row_s(log)
    irregular = any(np.ptp(np.diff(e.t)) > 0.02 * sample for e in log.episodes if len(e) > 2)
    if sample < 0.75 * CONTROL_DT:
        merged = max(1, round(CONTROL_DT / sample))
        return sample * merged, merged
    fine = irregular and sample < 2 * CONTROL_DT  # samples between grid steps are interpolated linearly
    target = CONTROL_DT / 2 if fine else CONTROL_DT
    return sample / np.ceil(sample / target - UNEVEN), 1


def _row_s(log: FlightLog) -> float:
    """The usual time in s from row to row."""
    return float(np.median(np.concatenate([np.diff(episode.t) for episode in log.episodes])))


def _merge(episode: Episode, merged: int) -> tuple[Floats, Floats, Floats]:
    """Times (T,), values and trust (T, 15) of an episode, each the mean of ``merged`` samples, angles unwrapped."""
    values = episode.values
    for angle in ANGLES:
        column = CHANNELS.index(angle)
        if np.isfinite(values[:, column]).all():
            values[:, column] = np.unwrap(values[:, column])
    trusted = np.ones_like(values)
    if episode.filled is not None:
        trusted[:, : episode.filled.shape[1]] -= episode.filled
    t, whole = episode.t, len(values) // merged * merged
    if merged > 1:
        t = t[:whole].reshape(-1, merged).mean(1)
        values = values[:whole].reshape(-1, merged, values.shape[1]).mean(1)
        trusted = np.round(trusted[:whole].reshape(-1, merged, values.shape[1]).mean(1))
    for angle in ("roll", "yaw"):
        trusted[:, CHANNELS.index(angle)] *= _trust_upright(values)
    return t, values, trusted


def _commands_on_grid(episode: Episode, dt: float, length: int) -> Floats:
    """Mean command (length, n) during each grid step, exact for commands held from row to row or for parts of it."""
    edges = episode.t[0] + np.arange(length + 1) * dt
    ends = np.append(episode.t, max(edges[-1], episode.t[-1]) + dt)
    commands = episode.commands
    if episode.parts is not None:
        count = episode.parts.shape[1]
        ends = np.append(ends[:-1, None] + np.diff(ends)[:, None] * np.arange(count) / count, ends[-1])
        commands = episode.parts.reshape(len(ends) - 1, -1)
    impulse = np.cumsum(np.diff(ends)[:, None] * commands, axis=0)
    impulse = np.concatenate([np.zeros((1, impulse.shape[1])), impulse])
    at_edges = np.stack([np.interp(edges, ends, column) for column in impulse.T], axis=1)
    return np.clip(np.diff(at_edges, axis=0) / dt, -1.0, 1.0)
