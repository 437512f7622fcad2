"""A flight log cut into short windows on a uniform time grid, ready to be simulated side by side."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auv_torchrl.flightlog import Episode, FlightLog, FlightLogError
from auv_torchrl.flightlog.log import ANGLES, SampleErrors
from auv_torchrl.physics import CONTROL_DT
from auv_torchrl.sensors import MOTION

Floats = NDArray[Any]  # float64 throughout; numpy's stubs lose it in half of the calls
CHANNELS = MOTION
LEAST_SAMPLES = 6  # for a first parabola
MAX_WINDOWS = 180  # 6 minutes of windows of 2 s: what a value is unsure by is then the model's error, not the noise


@dataclass(frozen=True)
class Windows:
    """``W`` windows of ``S`` steps with up to ``m`` samples of the ``C`` measured channels.

    The command of grid step k of an episode is the mean of what was commanded during it.
    """

    dt: float  # s, grid step
    steps: int
    channels: tuple[str, ...]  # measured, out of CHANNELS
    commands: Floats  # (E, T, n) on the grid
    episode: np.ndarray  # (W,) row of commands
    number: np.ndarray  # (W,) number of the episode in the log
    start: np.ndarray  # (W,) grid step at which the window begins
    origin: np.ndarray  # (W,) s, time of the first grid step in its episode
    index: np.ndarray  # (W, m) grid step of each sample, from the start of the window
    fraction: Floats  # (W, m) of a step behind it
    measured: Floats  # (W, m, C)
    present: np.ndarray  # (W, m) True where there is a sample
    trust: Floats  # (W, m, C) factor on each number: 1 measured, 0 missing or filled in, between them an outlier
    resolution: Floats  # (C,) step in which each channel was written; 0 where it is finer than anything
    guess: Floats  # (W, 12) pose and velocity at the start, from a local fit to the samples
    parts: Floats | None = None  # (E, T, P, n) commands in P equal parts of each grid step, where they change within
    errors: SampleErrors = SampleErrors()  # what the log says of errors that are no white noise
    whitening: Floats | None = None  # (W, K, K) of the K = m C numbers of a window; None: their noise is white

    def __len__(self) -> int:
        return len(self.episode)

    @property
    def angular(self) -> np.ndarray:
        """(C,) True for channels that are angles."""
        return np.array([channel in ANGLES for channel in self.channels])

    @property
    def time(self) -> Floats:
        """(W,) s since the start of the episode at the start of each window."""
        return self.origin + self.start * self.dt

    @property
    def held(self) -> Floats:
        """Commands (E, T, P, n) that were held for equal parts of each grid step; P is 1 where they change between."""
        return self.commands[:, :, None] if self.parts is None else self.parts

    @property
    def numbers(self) -> float:
        """How many numbers were measured, outliers by what they count."""
        return float((self.trust**2).sum())

    def subset(self, chosen: np.ndarray | slice) -> "Windows":
        """Some of the windows."""
        names = ["episode", "number", "start", "origin", "index", "fraction", "measured", "present", "trust", "guess"]
        names += [] if self.whitening is None else ["whitening"]
        return replace(self, **{name: getattr(self, name)[chosen] for name in names})

    def split(self, steps: int) -> "Windows":
        """Each window as ``S / steps`` shorter ones, in order; ``steps`` divides ``S``."""
        parts = self.steps // steps
        position = self.index + self.fraction
        rows = []
        for w, part in np.ndindex(len(self), parts):
            inside = self.present[w] & (self.index[w] >= part * steps) & (self.index[w] < (part + 1) * steps)
            rows.append((w, part, inside))
        most = max(int(inside.sum()) for _, _, inside in rows)
        shape = (len(rows), most)
        index, fraction, present = np.zeros(shape, int), np.zeros(shape), np.zeros(shape, bool)
        measured, trust = (np.zeros((*shape, len(self.channels))) for _ in range(2))
        guess = np.empty((len(rows), 12))
        columns = [CHANNELS.index(channel) for channel in self.channels]
        for row, (w, part, inside) in enumerate(rows):
            k = int(inside.sum())
            index[row, :k], fraction[row, :k] = self.index[w, inside] - part * steps, self.fraction[w, inside]
            measured[row, :k], present[row, :k] = self.measured[w, inside], True
            trust[row, :k] = self.trust[w, inside]
            away = np.where(self.present[w], np.abs(position[w] - part * steps) * self.dt, np.inf)
            near = away <= max(0.3, np.partition(away, 3)[3])  # a slow log has fewer than four within 0.3 s
            values = np.full((int(near.sum()), 12), np.nan)
            values[:, columns] = self.measured[w, near]
            guess[row] = _guess_start((position[w, near] - part * steps) * self.dt, values)
        owner = np.repeat(np.arange(len(self)), parts)
        start = self.start[owner] + np.tile(np.arange(parts) * steps, len(self))
        whole = replace(self.subset(owner), steps=steps, start=start)
        return replace(
            whole, index=index, fraction=fraction, measured=measured, present=present, trust=trust, guess=guess,
            whitening=None,
        )  # fmt: skip

    def residual(self, predicted: Floats) -> Floats:
        """Measured less predicted (W, ..., m, C), angles wrapped, each number times the trust in it, then whitened."""
        extra = predicted.ndim - self.measured.ndim
        shape = (len(self), *(1,) * extra)
        left = self.measured.reshape(*shape, *self.measured.shape[1:]) - predicted
        left[..., self.angular] -= 2 * np.pi * np.round(left[..., self.angular] / (2 * np.pi))
        return self.whitened(left * self.trust.reshape(*shape, *self.trust.shape[1:]))

    def whitened(self, numbers: Floats) -> Floats:
        """Numbers (W, ..., m, C), or (W, K, N), so that errors of all colours are as large as the white noise."""
        if self.whitening is None:
            return numbers
        k = self.whitening.shape[-1]
        if numbers.shape[1] == k and numbers.ndim == 3:
            return self.whitening @ numbers
        rows = numbers.reshape(len(self), -1, k) @ self.whitening.swapaxes(1, 2)
        return rows.reshape(numbers.shape)


def grid_step(log: FlightLog) -> tuple[float, int]:
    """Grid step in s, near the control step, and how many samples are averaged into one (1 unless sampled fast)."""
    sample = float(np.median(np.concatenate([np.diff(episode.t) for episode in log.episodes])))
    irregular = any(np.ptp(np.diff(e.t)) > 0.02 * sample for e in log.episodes if len(e) > 2)
    if sample < 0.75 * CONTROL_DT:
        merged = max(1, round(CONTROL_DT / sample))
        return sample * merged, merged
    fine = irregular and sample < 2 * CONTROL_DT  # samples between grid steps are interpolated linearly
    target = CONTROL_DT / 2 if fine else CONTROL_DT
    return sample / np.ceil(sample / target - 1e-6), 1


def cut_windows(log: FlightLog, window_s: float, lead_s: float, bin_s: float = 0.0) -> Windows:
    """Windows of ``window_s`` seconds, end to end, the first ``lead_s`` seconds of each episode left out.

    With ``bin_s``, their length is a whole number of pairs of bins of that many seconds.

    The lead is there because nobody logged what was commanded before the first row.

    Raises:
        ValueError: if no episode holds a window.
    """
    dt, merged = grid_step(log)
    within = max([merged, *(episode.parts.shape[1] for episode in log.episodes if episode.parts is not None)])
    pair = 2 * max(1, round(bin_s / dt))
    steps = pair * max(1, round(window_s / (pair * dt))) if bin_s else max(4, round(window_s / dt))
    channels = tuple(axis for axis in CHANNELS if axis in log.axes)
    columns = [CHANNELS.index(channel) for channel in channels]
    lead = round(lead_s / dt)
    grids, rows = [], []
    for order, episode in enumerate(log.episodes):
        t, values, trusted = _merge(episode, merged)
        length = int(np.floor((t[-1] - episode.t[0]) / dt + 1e-6)) + 1
        grids.append(_commands_on_grid(episode, dt / within, length * within).reshape(length, within, -1))
        position = (t - episode.t[0]) / dt
        first = _first_seen(position, trusted[:, columns], lead) if log.errors.snapshot_s else lead
        for start in range(first, length - steps + 1, steps):
            inside = np.flatnonzero((position > start - 1e-6) & (position < start + steps - 1e-6))
            seen = inside[trusted[inside][:, columns].any(1)]
            inside = seen if log.errors.snapshot_s else inside  # rows that are there for a command alone say nothing
            ends = np.concatenate([[start], position[seen], [start + steps]])
            if len(seen) < 4 or np.diff(ends).max() * dt > max(0.5, 0.25 * window_s):
                continue
            rows.append((order, episode, start, position[inside] - start, values[inside], trusted[inside]))
    if not rows:
        raise FlightLogError(
            f"{log.name}: no episode holds a window of {window_s:g} s behind the first {lead_s:g} s: give a longer log"
        )
    if len(rows) > MAX_WINDOWS:
        rows = [rows[i] for i in np.linspace(0, len(rows) - 1, MAX_WINDOWS).astype(int)]
    most = max(len(row[3]) for row in rows)
    number = len(rows)
    index, fraction = np.zeros((number, most), int), np.zeros((number, most))
    measured, trust = (np.zeros((number, most, len(columns))) for _ in range(2))
    present = np.zeros((number, most), bool)
    guess = np.zeros((number, 12))
    for w, (_, _, _, position, values, trusted) in enumerate(rows):
        k = len(position)
        whole = np.floor(position + 1e-6).astype(int)
        index[w, :k], fraction[w, :k] = whole, np.where(position - whole < 1e-3, 0.0, position - whole)
        measured[w, :k], present[w, :k], trust[w, :k] = values[:, columns], True, trusted[:, columns]
        guess[w] = _guess_start(position * dt, values)
    longest = max(len(grid) for grid in grids)
    parts = np.stack([np.pad(grid, ((0, longest - len(grid)), (0, 0), (0, 0)), mode="edge") for grid in grids])
    return Windows(
        dt=dt,
        steps=steps,
        channels=channels,
        commands=parts.mean(2),
        parts=parts if np.ptp(parts, axis=2).any() else None,
        episode=np.array([row[0] for row in rows]),
        number=np.array([row[1].number for row in rows]),
        start=np.array([row[2] for row in rows]),
        origin=np.array([row[1].t[0] for row in rows]),
        index=index,
        fraction=fraction,
        measured=measured,
        present=present,
        trust=trust,
        resolution=np.array([log.resolution.get(channel, 0.0) for channel in channels]),
        guess=guess,
        errors=log.errors,
    )


def _first_seen(position: Floats, trusted: Floats, lead: int) -> int:
    """The grid step of the first sample behind the lead, where a window can begin with what was measured."""
    behind = position[trusted.any(1) & (position > lead - 0.5)]
    return round(float(behind[0])) if len(behind) else lead


def _merge(episode: Episode, merged: int) -> tuple[Floats, Floats, Floats]:
    """Times (T,), values and trust (T, 12) of an episode, each the mean of ``merged`` samples, angles unwrapped."""
    values = np.concatenate([episode.pose, episode.velocity], axis=1)
    for angle in ANGLES:
        column = CHANNELS.index(angle)
        if np.isfinite(values[:, column]).all():
            values[:, column] = np.unwrap(values[:, column])
    trusted = np.ones_like(values) if episode.filled is None else 1.0 - episode.filled
    if merged == 1:
        return episode.t, values, trusted
    whole = len(values) // merged * merged
    return (
        episode.t[:whole].reshape(-1, merged).mean(1),
        values[:whole].reshape(-1, merged, values.shape[1]).mean(1),
        np.round(trusted[:whole].reshape(-1, merged, values.shape[1]).mean(1)),
    )


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


def _guess_start(t: Floats, values: Floats) -> Floats:
    """Pose and velocity (12,) at the start of a window, from a parabola through its first samples."""
    few = min(len(t), max(4, int(np.searchsorted(t, 0.4))))
    if few < 4:
        raise FlightLogError(f"a window has {few} samples near its start, at least 4 are needed: give longer windows")
    powers = np.vander(t[:few], 3, increasing=True)
    start = np.zeros(12)
    pose_rate = np.zeros(6)
    for column in range(12):
        if np.isfinite(values[:few, column]).all():
            coefficients = np.linalg.lstsq(powers, values[:few, column], rcond=None)[0]
            start[column] = coefficients[0]
            if column < 6:
                pose_rate[column] = coefficients[1]
    known = np.asarray(np.isfinite(values[:few]).all(0))
    yaw = start[5]
    c, s = np.cos(yaw), np.sin(yaw)
    from_pose = [c * pose_rate[0] + s * pose_rate[1], c * pose_rate[1] - s * pose_rate[0], *pose_rate[2:]]
    start[6:] = np.where(known[6:], start[6:], from_pose)
    return start
