"""Short windows of a flight log on a uniform time grid, ready to be simulated side by side."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auv_torchrl.flightlog import FlightLogError
from auv_torchrl.flightlog.log import ANGLES, SampleErrors
from auv_torchrl.physics.kinematics import (
    conjugate,
    euler_angles,
    least_turn,
    matvec,
    normalise,
    quaternion_from_euler,
    quaternion_product,
    rotation_matrix,
)
from auv_torchrl.quantities import counted
from auv_torchrl.sensors import MOTION, is_felt

Floats = NDArray[Any]  # float64 throughout; numpy's stubs lose it in half of the calls

PARTS = 6  # in which a triangle is multiplied, 0.6 times the work of a square; more save less than they cost
LEAST_PART = 50  # numbers of such a part: of a smaller one, the call takes longer than its work
AT_ONCE = 24 << 20  # bytes of an array over windows; results that come from one take several times as much
# Bytes of the slopes of all windows of a log. A diagnosis takes up to ten times as much at its worst, beside 0.2 GB of
# libraries, and 1.5 GB are what it may in all. Of 15 channels at 20 Hz that is 5 minutes, with two forces per bin.
MOST = 96 << 20
# Free numbers that each number of a window counts for where errors are whitened, as in logs of an autopilot: so a .BIN
# of 22 minutes beside a healthy one of 23 takes 0.6 GB, which a computer on the vehicle has for it.
WHITENING = 1.1
FEWEST = 12  # windows, however large


@dataclass(frozen=True)
class Windows:
    """``W`` windows of ``S`` steps with up to ``m`` samples of the ``C`` measured channels.

    The command of a grid step is the mean of the commands during that step.
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
    volts: Floats | None = None  # (E, T) of the battery at each grid step, NaN where not logged; None: nowhere
    around: float = 0.5  # grid steps before and behind a sample, over which a specific force is averaged
    share: float = 1.0  # of all windows of the log: of a long log, some are taken
    # Lower triangles (W, G, k, k) of G groups of k numbers whose errors go together: the m samples of each channel, or
    # all K = m C numbers of a window. None: their noise is white.
    whitening: Floats | None = None

    def __len__(self) -> int:
        return len(self.episode)

    @property
    def angular(self) -> np.ndarray:
        """(C,) True for channels that are angles."""
        return np.array([channel in ANGLES for channel in self.channels])

    @property
    def specific_force(self) -> np.ndarray:
        """(C,) True for channels of an accelerometer, which hold means of the specific force around each sample."""
        return is_felt(self.channels)

    @property
    def specific_force_channels(self) -> tuple[str, ...]:
        """Names of the channels of an accelerometer, in order."""
        return tuple(name for name, here in zip(self.channels, self.specific_force, strict=True) if here)

    @property
    def time(self) -> Floats:
        """(W,) s since the start of the episode at the start of each window."""
        return self.origin + self.start * self.dt

    @property
    def sampled(self) -> Floats:
        """(W, m) s from the start of its window to each sample."""
        return (self.index + self.fraction) * self.dt

    @property
    def held(self) -> Floats:
        """Commands (E, T, P, n) that were held for equal parts of each grid step; P is 1 where they change between."""
        return self.commands[:, :, None] if self.parts is None else self.parts

    @property
    def numbers(self) -> float:
        """Measured numbers of all windows; an outlier counts by its trust."""
        return float((self.trust**2).sum())

    @property
    def numbers_of_each(self) -> Floats:
        """Measured numbers (W,) of each window; an outlier counts by its trust."""
        return (self.trust**2).sum((1, 2))

    def subset(self, chosen: np.ndarray | slice) -> "Windows":
        """Some of the windows."""
        names = ["episode", "number", "start", "origin", "index", "fraction", "measured", "present", "trust", "guess"]
        names += [] if self.whitening is None else ["whitening"]
        return replace(self, **{name: getattr(self, name)[chosen] for name in names})

    def thinned(self, most: int) -> "Windows":
        """At most so many of the windows, evenly spread over them."""
        return self if len(self) <= most else self.subset(np.linspace(0, len(self) - 1, most).astype(int))

    def split(self, steps: int) -> "Windows":
        """Each window as ``S / steps`` shorter ones, in order; ``steps`` divides ``S``."""
        parts = self.steps // steps
        owner, first = np.repeat(np.arange(len(self)), parts), np.tile(np.arange(parts) * steps, len(self))
        whole = replace(self, whitening=None).subset(owner)
        times = (whole.index + whole.fraction - first[:, None]) * self.dt
        away = np.where(whole.present, np.abs(times), np.inf)
        reach = np.maximum(0.3, np.partition(away, 3)[:, 3:4])  # a slow log has fewer than four within 0.3 s
        moved, columns = columns_of_motion(self.channels)
        values = np.full((*away.shape, 12), np.nan)
        values[..., columns] = whole.measured[..., moved]
        near = [(t[seen], v[seen]) for t, v, seen in zip(times, values, away <= reach, strict=True)]
        index = whole.index - first[:, None]
        inside = whole.present & (index >= 0) & (index < steps)
        rows, own = np.arange(len(owner))[:, None], np.argsort(~inside, axis=1, kind="stable")[:, : inside.sum(1).max()]
        present = inside[rows, own]
        return replace(
            whole,
            steps=steps,
            start=whole.start + first,
            index=np.where(present, index[rows, own], 0),
            fraction=np.where(present, whole.fraction[rows, own], 0.0),
            measured=np.where(present[..., None], whole.measured[rows, own], 0.0),
            present=present,
            trust=np.where(present[..., None], whole.trust[rows, own], 0.0),
            guess=guess_starts([t for t, _ in near], [v for _, v in near]),
        ).without_edges()

    def without_edges(self) -> "Windows":
        """No trust in a specific force so near the ends of a window that its mean reaches into another window."""
        if not self.specific_force.any():
            return self
        at = self.index + self.fraction
        beyond = (at < self.around - 1e-6) | (at > self.steps - self.around + 1e-6)
        return replace(self, trust=np.where(beyond[..., None] & self.specific_force, 0.0, self.trust))

    def residual(self, predicted: Floats) -> Floats:
        """Measured less predicted (W, ..., m, C), angles wrapped, each number times the trust in it, then whitened."""
        between = tuple(range(1, predicted.ndim - 2))
        left = np.expand_dims(self.measured, between) - predicted
        left[..., self.angular] = least_turn(left[..., self.angular])
        return self.whitened(left * np.expand_dims(self.trust, between))

    def whitened(self, numbers: Floats) -> Floats:
        """Numbers (W, ..., m, C), or (W, K, N), so that errors of all colours are as large as the white noise."""
        if self.whitening is None:
            return numbers
        groups, k = self.whitening.shape[1:3]
        if numbers.shape[1] != groups * k or numbers.ndim != 3:
            columns = numbers.reshape(len(self), -1, groups * k).swapaxes(1, 2)
            return self.whitened(columns).swapaxes(1, 2).reshape(numbers.shape)
        own = np.moveaxis(numbers.reshape(len(self), k, groups, -1), 2, 1)  # (W, G, k, N)
        found, edges = np.empty(numbers.shape), np.linspace(0, k, 1 + min(PARTS, max(1, k // LEAST_PART))).astype(int)
        by_group = np.moveaxis(found.reshape(len(self), k, groups, -1), 2, 1)
        for first, behind in zip(edges, edges[1:], strict=False):  # right of the diagonal is 0
            part = self.whitening[:, :, first:behind, :behind].astype(float)
            by_group[:, :, first:behind] = part @ own[:, :, :behind]
        return found


def columns_of_motion(channels: tuple[str, ...]) -> tuple[list[int], list[int]]:
    """Positions of the channels that are numbers of a motion, and which of the 12 numbers of a motion they are."""
    moved = [column for column, channel in enumerate(channels) if channel in MOTION]
    return moved, [MOTION.index(channels[column]) for column in moved]


def guess_starts(times: Sequence[Floats], values: Sequence[Floats]) -> Floats:
    """Pose and velocity (W, 12) at the start of each window, from a parabola through its first samples.

    The attitude is that of a parabola through quaternions: angles and their rates are none where a vehicle is steep.

    Args:
        times: (m,) s since the start of each window.
        values: (m, 12) measured then, NaN where nothing was.
    """
    few = np.array([min(len(t), max(4, int(np.searchsorted(t, 0.4)))) for t in times])
    if few.min() < 4:
        raise FlightLogError(
            f"a window has {counted(int(few.min()), 'sample')} near its start, at least 4 are needed: give longer "
            "windows"
        )
    parabolas, turns = np.empty((len(few), 3, 12)), np.empty((len(few), 3, 4))
    known = np.empty((len(few), 12), bool)
    for number in np.unique(few):
        rows = np.flatnonzero(few == number).tolist()
        powers = np.stack([times[row][:number] for row in rows])[..., None] ** np.arange(3)
        first = np.stack([values[row][:number] for row in rows])
        known[rows] = np.isfinite(first).all(1)
        first, parabola = np.where(known[rows, None], first, 0.0), np.linalg.pinv(powers)
        parabolas[rows] = parabola @ first
        turns[rows] = parabola @ attitudes(first)
    start, attitude = parabolas[:, 0].copy(), normalise(turns[:, 0])
    angles = np.stack(euler_angles(attitude), axis=1)
    start[:, 3:6] = np.where(known[:, 3:6], start[:, 3:6] + least_turn(angles - start[:, 3:6]), 0.0)
    moving = matvec(rotation_matrix(attitude).mT, parabolas[:, 1, :3])
    from_pose = np.concatenate([moving, body_rate(attitude, turns[:, 1])], axis=1)
    start[:, 6:] = np.where(known[:, 6:], start[:, 6:], from_pose)
    return start


def attitudes(motion: Floats) -> Floats:
    """Quaternions (W, m, 4) of samples of a motion (W, m, 12), each with the sign that is nearer to the one before.

    A parabola goes through them also where a vehicle is steep: there angles jump.
    """
    quaternions = quaternion_from_euler(motion[..., 3], motion[..., 4], motion[..., 5])
    turned = (quaternions[:, 1:] * quaternions[:, :-1]).sum(-1) < 0
    signs = np.cumprod(np.where(turned, -1.0, 1.0), axis=1)
    return np.concatenate([quaternions[:, :1], quaternions[:, 1:] * signs[..., None]], axis=1)


def body_rate(quaternion: Floats, change: Floats) -> Floats:
    """Angular velocity (..., 3) in rad/s of a quaternion (..., 4) and its rate; its change from the second derivative.

    Of ``omega = 2 q* dq/dt`` the derivative has a second term, which is no vector (Shabana 2013, Sec. 3.5).
    """
    return 2.0 * quaternion_product(conjugate(quaternion), change)[..., 1:]


def affordable(numbers: int, free: int, coloured: bool) -> int:
    """How many windows fit the memory, each with so many measured ``numbers`` and ``free`` numbers.

    Where errors are ``coloured``, the whitening of the numbers is held beside the slopes.
    """
    each = 8 * numbers * (free + (WHITENING * numbers if coloured else 0.0))
    return max(FEWEST, int(MOST / each))


def chunks(windows: int, each: int, most: int = AT_ONCE) -> Iterator[slice]:
    """Slices of windows of ``each`` bytes, all about as long, of which none takes more than ``most`` bytes."""
    count = min(windows, -(-windows * each // most)) or 1
    edges = np.linspace(0, windows, count + 1).astype(int).tolist()
    return (slice(first, behind) for first, behind in zip(edges, edges[1:], strict=False))
