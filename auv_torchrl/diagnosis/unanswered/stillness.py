"""The stretches in which a channel stands still although the vehicle is commanded.

A channel that does not answer is a constant, or a slow walk, with white noise of its own. A channel that answers shows
what the simulated vehicle makes of the commands. So two sums over a stretch decide: how far the channel moves, beyond
white noise, and how far the commands would have moved the vehicle of the file from rest, beyond what an unknown start
and a constant force can make. Whether that vehicle is the right one is weighed later.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from auv_torchrl.diagnosis.identify.hypotheses import Settings, batch
from auv_torchrl.diagnosis.motion.actuation import actuate
from auv_torchrl.diagnosis.motion.cut import cut_windows, grid_step
from auv_torchrl.diagnosis.motion.rollout import fly
from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.flightlog import POSE, VELOCITY, FlightLog, FlightLogError
from auv_torchrl.flightlog.log import ACCELERATION, ANGLES
from auv_torchrl.flightlog.signals import runs
from auv_torchrl.physics.kinematics import least_turn
from auv_torchrl.sensors import CHANNELS
from auv_torchrl.vehicle import Vehicle

WINDOW_S = 3.0  # a command of 0.2 Hz shows in it, and a slow walk does not
FEWEST_SAMPLES = 12  # of a window, to tell motion from noise
SWALLOWED = 0.2  # of full command, from end to end, that a dead band may swallow
WHITE = 0.5  # of the white noise, in squares, by which a slow walk moves within a window at most
SHOWN = 0.15  # of the commanded motion, below which a channel does not answer
MOVED = 15.0  # standard deviations of its noise, each sample's counted, by which commands move a channel in a window,
FEWEST_WINDOWS = 2  # and in so many of them
LEAST_SHOWN = 2e-3  # m, rad, m/s, rad/s, m/s^2: root mean square of a commanded motion that sensors show
SURE = 2.0  # standard deviations of what is measured of a motion
LEAST_S = 6.0  # of standing still, less of which is a pause
WHOLE = 0.9  # of the windows, from which a channel stands still all along
# Channels in which a vehicle stands still for a while because its autopilot, or its weight, holds it level
STABILISED = ("roll", "pitch", "p", "q", *ACCELERATION)
OF_ONE_SENSOR = ANGLES, ("p", "q", "r")  # where heading or yaw rate stands still at once, it is the sensor
TOGETHER = 0.5  # of the shorter of two stretches, from which they are one
AWAY = 4.0  # standard deviations from where a channel stood, beyond which it moves again,
IN_A_ROW = 3  # with so many samples
# Of what commands should make of all channels together, below which a vehicle hardly moves: beside files that are off
# by factors, vehicles that swim make a fifth and more. And the correlation with it, below which it moves by itself.
HARDLY, BY_ITSELF = 0.1, 0.1
LEAST_NOISE = 1e-5  # m, rad, m/s, rad/s, m/s^2: a hundredth of what the best sensors of this kind scatter by


@dataclass(frozen=True)
class Stillness:
    """A channel that stands still, or moves by itself, however the vehicle is commanded."""

    channel: str
    episode: int | None = None  # number; None: all along
    first_s: float = 0.0  # since the start of the episode
    last_s: float = 0.0

    def holds(self, episode: int, time_s: float) -> bool:
        """Whether it lasts at a time of an episode."""
        return self.episode is None or (self.episode == episode and self.first_s <= time_s <= self.last_s)

    def is_with(self, other: "Stillness") -> bool:
        """Whether another channel stands still in the same stretch."""
        if self.episode != other.episode or self.channel == other.channel:
            return False
        shared = min(self.last_s, other.last_s) - max(self.first_s, other.first_s)
        return self.episode is None or shared > TOGETHER * min(self.last_s - self.first_s, other.last_s - other.first_s)

    def covers(self, t: Floats) -> np.ndarray:
        """At which times (T,) of its episode it lasts."""
        return (t >= self.first_s) & (t <= self.last_s)


def channels_of(stretches: Iterable[Stillness]) -> tuple[str, ...]:
    """The channels of stretches, each once, in the order of all channels."""
    return tuple(sorted({entry.channel for entry in stretches}, key=CHANNELS.index))


@dataclass(frozen=True)
class Motions:
    """Of each window (W,) and channel (C,), sums of squares over samples: how far it moves, and should have moved."""

    windows: Windows
    moved: Floats  # beyond white noise; below 0 by chance
    noise: Floats  # white noise
    commanded: Floats
    count: Floats  # samples; 0 where too few to tell
    bent: Floats  # like ``moved``, beyond what a start and a constant force make
    along: Floats  # sums of products of the motion and the one that was commanded

    def white(self, rows: np.ndarray | slice = slice(None)) -> Floats:
        """(C,) the variance of the white noise of each channel, over some windows."""
        noise = self.noise[rows].sum(0) / np.maximum(self.count[rows].sum(0), 1.0)
        return np.maximum(np.maximum(noise, LEAST_NOISE**2), self.windows.resolution**2 / 12)

    def stands(self, channel: int, rows: np.ndarray) -> bool:
        """Whether a channel does not move over some windows in which the commands would have moved it."""
        count, each = self.count[rows, channel], self.commanded[rows, channel]
        total, commanded, moved = float(count.sum()), float(each.sum()), float(self.moved[rows, channel].sum())
        if not total:
            return False
        white = float(self.white(rows)[channel])
        slow = min(WHITE * white * total, SHOWN**2 * commanded)
        enough = np.count_nonzero(each > np.maximum(MOVED**2 * white, LEAST_SHOWN**2 * count)) >= FEWEST_WINDOWS
        return bool(enough and moved < max(slow, SURE * white * np.sqrt(2 * total)))

    def still(self, channel: int) -> np.ndarray:
        """(W,) windows in which a channel is constant but for white noise and a slow walk."""
        n, noise = np.maximum(self.count[:, channel], 1.0), self.noise[:, channel]
        slow = np.maximum(WHITE, 2 * SURE * np.sqrt(2 / n)) * noise
        return (self.count[:, channel] > 0) & (self.moved[:, channel] < slow + n * LEAST_NOISE**2)


def find_stillness(log: FlightLog, vehicle: Vehicle, settings: Settings) -> tuple[Stillness, ...]:
    """Every channel that does not answer to commands, all along or for a stretch.

    Args:
        log: as it was read.
        vehicle: that should explain it, empty batch.
        settings: of the diagnosis.
    """
    motions = measure_motions(log, vehicle, settings)
    if motions is None:
        return ()
    found = [entry for column in range(len(motions.windows.channels)) for entry in _of_channel(log, motions, column)]
    return tuple(entry for entry in found if not _is_held_level(entry, found))


def _is_held_level(entry: Stillness, found: Sequence[Stillness]) -> bool:
    """Whether a channel that stands still for a while may be held level: what else its sensor measures goes on."""
    if entry.episode is None or entry.channel not in STABILISED:
        return False
    others = {name for sensor in OF_ONE_SENSOR if entry.channel in sensor for name in sensor} - set(STABILISED)
    return not any(other.channel in others and entry.is_with(other) for other in found)


def hardly_moves(log: FlightLog, vehicle: Vehicle, settings: Settings) -> float | None:
    """How far a vehicle moves of how far the commands should move it, where that is next to nothing; else None.

    All channels count together, each in its noise. What rocks a held vehicle moves it, but not as commanded: neither
    the motion may be large, nor the part of it that goes with the commands.
    """
    motions = measure_motions(log, vehicle, settings)
    if motions is None:
        return None
    rows = motions.commanded.any(1)
    bent, along, commanded = (
        (each[rows] / motions.white()).sum(1) for each in (motions.bent, motions.along, motions.commanded)
    )
    if np.count_nonzero(commanded > MOVED**2) < FEWEST_WINDOWS:
        return None
    share = float(np.sqrt(max(bent.sum(), 0.0) / commanded.sum()))
    return share if share < HARDLY and along.sum() < BY_ITSELF * HARDLY * commanded.sum() else None


def standing(log: FlightLog, vehicle: Vehicle, settings: Settings) -> frozenset[str]:
    """The channels that do not move all along, whether or not the commands should have moved them."""
    motions = measure_motions(log, vehicle, settings)
    if motions is None:
        return frozenset()
    columns = enumerate(motions.windows.channels)
    return frozenset(name for column, name in columns if motions.still(column).mean() >= WHOLE)


def _of_channel(log: FlightLog, motions: Motions, column: int) -> Iterator[Stillness]:
    windows = motions.windows
    name, still, has_samples = windows.channels[column], motions.still(column), motions.count[:, column] > 0
    if not still.any():
        return
    if still[has_samples].mean() >= WHOLE:
        if motions.stands(column, still):
            yield Stillness(name)
        return
    for number in np.unique(windows.number).tolist():
        rows, reached = np.flatnonzero(windows.number == number), -np.inf
        for first, behind in runs(still[rows]):
            run = rows[first:behind]
            begin, end = windows.time[run[0]], windows.time[run[-1]] + windows.steps * windows.dt
            if end - begin >= LEAST_S and motions.stands(column, run):
                stretch = Stillness(name, number, *_to_the_sample(log, number, name, float(begin), float(end)))
                if not stretch.first_s < reached:  # else it is the one before, which a single window interrupted
                    yield stretch
                reached = max(reached, stretch.last_s)


def _to_the_sample(log: FlightLog, number: int, channel: str, begin: float, end: float) -> tuple[float, float]:
    """Times in s from which and to which a channel stands still, by samples around whole windows that do."""
    episode = next(episode for episode in log.episodes if episode.number == number)
    values = episode.values[:, CHANNELS.index(channel)]
    inside = np.flatnonzero((episode.t >= begin) & (episode.t <= end) & np.isfinite(values))
    few = max(FEWEST_SAMPLES, len(inside) // 4)
    first, last = int(inside[0]), int(inside[-1])
    away = []
    for some in (inside[:few], inside[-few:]):
        apart = values - np.median(values[some])
        apart = least_turn(apart) if channel in ANGLES else apart
        away.append(np.abs(apart) > AWAY * max(float(np.std(apart[some])), LEAST_NOISE))
    while first > 0 and not away[0][max(0, first - IN_A_ROW) : first].all():
        first -= 1
    while last < len(values) - 1 and not away[1][last + 1 : last + 1 + IN_A_ROW].all():
        last += 1
    return float(episode.t[first]), float(episode.t[last])


def measure_motions(log: FlightLog, vehicle: Vehicle, settings: Settings) -> Motions | None:
    """How far each channel moves in windows of a log, and should have moved; None where no window is long enough."""
    row_s = grid_step(log)[0]
    try:
        windows = cut_windows(log, max(WINDOW_S, FEWEST_SAMPLES * row_s), settings.lead_s)
    except FlightLogError:  # the log is shorter than that
        return None
    response = commanded_motion(windows, vehicle)
    shape = len(windows), len(windows.channels)
    moved, noise, commanded, count, bent, along = (np.zeros(shape) for _ in range(6))
    for w, c in np.ndindex(shape):
        seen = windows.present[w] & (windows.trust[w, :, c] > 0) & np.isfinite(windows.measured[w, :, c])
        n = int(seen.sum())
        if n < FEWEST_SAMPLES or not np.isfinite(response[w, seen, c]).all():
            continue
        values = windows.measured[w, seen, c]
        values = np.unwrap(values) if windows.angular[c] else values
        values = values - values.mean()
        own = beyond_start(windows.sampled[w, seen], response[w, seen, c], windows.channels[c])
        total = float(values @ values)
        moved[w, c] = float(values[1:] @ values[:-1]) + total / (n - 1)
        noise[w, c] = max(total * n / (n - 1) - max(moved[w, c], 0.0), 0.0)
        commanded[w, c], count[w, c], along[w, c] = float(own @ own), n, float(own @ values)
        apart = beyond_start(windows.sampled[w, seen], values, windows.channels[c])
        bent[w, c] = float(apart[1:] @ apart[:-1])
    return Motions(windows, moved, noise, commanded, count, bent, along)


def commanded_motion(windows: Windows, vehicle: Vehicle) -> Floats:
    """What commands that change make of each channel (W, m, C), beyond commands that stay at their mean.

    The vehicle begins at rest, where the window says. Commands that a dead band may swallow as a whole make nothing.
    """
    steady, lively = windows.commands.copy(), np.zeros(len(windows), bool)
    for w, (e, start) in enumerate(zip(windows.episode, windows.start, strict=True)):
        rows = slice(start, start + windows.steps)
        lively[w] = np.ptp(steady[e, rows], axis=0).max() > SWALLOWED
        steady[e, rows] = steady[e, rows].mean(0)
    own, begin = batch(vehicle, [{}]), windows.guess.copy()
    begin[:, 6:] = 0.0
    changing, staying = (
        fly(actuate(each, own), begin[:, None])[0][:, 0]
        for each in (windows, replace(windows, commands=steady, parts=None))
    )
    apart = changing - staying
    apart[..., windows.angular] = least_turn(apart[..., windows.angular])
    return np.where(lively[:, None, None], apart, 0.0)


def beyond_start(t: Floats, motion: Floats, channel: str) -> Floats:
    """A motion (m,) less what a start and a constant force can make of it: a parabola of a place, a line of a speed."""
    degree = 2 if channel in POSE else 1 if channel in VELOCITY else 0
    base = (t - t.mean())[:, None] ** np.arange(degree + 1)
    return motion - base @ np.linalg.lstsq(base, motion, rcond=None)[0]
