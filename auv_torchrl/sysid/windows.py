"""Windows of samples, the noise of their channels, and the disturbance that may act in them.

A log is cut into windows that are simulated side by side. Each window has an unknown first state, its start, and an
unknown slow force, its disturbance, which is constant over bins of some steps.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from auv_torchrl.sysid.model import Channel, Floats, wrapped

THIRD_DIFFERENCE = np.sqrt(20.0)  # white noise of size 1 has third differences of this size: 1 + 9 + 9 + 1
MEDIAN_TO_DEVIATION = 1.4826  # of a normal distribution
OUTLIER = 5.0  # standard deviations from which a sample counts less: of noise alone, one in two million does
LEAST_SAMPLES = 4  # of a window: a start has a value and a rate, and two more tell how noisy these are


@dataclass(frozen=True)
class Record:
    """One stretch of a log without a gap."""

    inputs: Floats  # (T, ...) held over each grid step
    times: Floats  # (m,) s since the first grid step
    values: Floats  # (m, C) measured then, NaN where a channel was not


@dataclass(frozen=True)
class Noise:
    """Errors of the samples: white noise, and an error that stays for a while, as estimates of a filter have it."""

    white: Floats  # (C,) standard deviation
    drift: Floats  # (C,) standard deviation of the error that stays; 0: none
    time: float = 1.0  # s, for which it stays (first-order Gauss-Markov)

    @staticmethod
    def of(white: Floats) -> "Noise":
        """White noise alone."""
        return Noise(np.asarray(white, float), np.zeros(len(white)))


@dataclass(frozen=True)
class Disturbance:
    """A force that nobody commanded: a first-order Gauss-Markov process of each force of the model."""

    size: Floats  # (f,) standard deviation
    time: float = 1.0  # s, correlation time
    bin_s: float = 0.4  # s, over which it is held constant


@dataclass(frozen=True)
class Windows:
    """``W`` windows of ``S`` steps with up to ``m`` samples of ``C`` channels; ``K = m C`` numbers a window."""

    dt: float  # s
    channels: tuple[Channel, ...]
    inputs: Floats  # (W, S, ...)
    index: np.ndarray  # (W, m) grid step at or before each sample
    fraction: Floats  # (W, m) of a step behind it
    measured: Floats  # (W, m, C); 0 where nothing was measured
    trust: Floats  # (W, m, C) 1 measured, 0 not, between them an outlier
    noise: Noise
    record: np.ndarray  # (W,) number of the record
    whitening: Floats | None = None  # (W, C, m, m) of samples in units of the white noise; None: their noise is white

    def __len__(self) -> int:
        return len(self.measured)

    @property
    def steps(self) -> int:
        """Grid steps of a window."""
        return self.inputs.shape[1]

    @property
    def numbers(self) -> float:
        """How many numbers were measured, outliers by what they count."""
        return float((self.trust**2).sum())

    @property
    def times(self) -> Floats:
        """(W, m) s from the start of its window to each sample."""
        return (self.index + self.fraction) * self.dt

    def at_samples(self, on_grid: Floats) -> Floats:
        """Values (W, R, m, C) at the times of the samples, of values (W, R, S + 1, C) on the grid."""
        at = self.index[:, None, :, None]
        here = np.take_along_axis(on_grid, at, axis=2)
        ahead = np.take_along_axis(on_grid, np.minimum(at + 1, on_grid.shape[2] - 1), axis=2)
        change = ahead - here
        for column, channel in enumerate(self.channels):
            if channel.angular:
                change[..., column] = wrapped(change[..., column])
        return here + self.fraction[:, None, :, None] * change

    def residual(self, predicted: Floats) -> Floats:
        """Measured less predicted (W, R, m, C) as (W, K, R) in units of the noise."""
        left = self.measured[:, None] - predicted
        for column, channel in enumerate(self.channels):
            if channel.angular:
                left[..., column] = wrapped(left[..., column])
        return self.weighed(np.moveaxis(left, 1, -1))

    def weighed(self, columns: Floats) -> Floats:
        """Columns (W, m, C, N) as (W, K, N) in units of the noise, whitened."""
        scaled = columns * (self.trust / self.noise.white)[..., None]
        if self.whitening is not None:
            scaled = np.moveaxis(self.whitening @ np.moveaxis(scaled, 2, 1), 1, 2)
        return scaled.reshape(len(self), -1, columns.shape[-1])

    def with_noise(self, noise: Noise, trust: Floats | None = None) -> "Windows":
        """The same samples with other noise, and other trust in them."""
        trust = self.trust if trust is None else trust
        whitening = _whitening(self.times, trust, noise) if noise.drift.any() else None
        return replace(self, noise=noise, trust=trust, whitening=whitening)


def cut(
    records: Sequence[Record], channels: Sequence[Channel], dt: float, steps: int, noise: Noise | None = None
) -> Windows:
    """Windows of ``steps`` steps of all records, one behind the other.

    What a record has beyond its last whole window is left out, and so are windows with fewer than four samples. Noise
    that is not given is worked out from third differences, which a smooth motion hardly has.

    Raises:
        ValueError: if the records do not fit each other or no window is left.
    """
    found = []
    for number, record in enumerate(records):
        if record.values.shape[1:] != (len(channels),):
            raise ValueError(
                f"record {number} has values {record.values.shape}: expected ({len(record.times)}, {len(channels)})"
            )
        at = record.times / dt
        for first in range(0, len(record.inputs) - steps + 1, steps):
            rows = np.flatnonzero((at >= first - 1e-9) & (at <= first + steps + 1e-9))
            if np.isfinite(record.values[rows]).any(1).sum() >= LEAST_SAMPLES:
                place = np.clip(at[rows] - first, 0.0, steps)
                found.append((number, record.inputs[first : first + steps], place, record.values[rows]))
    if not found:
        long = max((len(record.inputs) * dt for record in records), default=0.0)
        raise ValueError(
            f"no window of {steps * dt:.3g} s with {LEAST_SAMPLES} samples is in records of up to {long:.3g} s: "
            "give longer records or shorter windows"
        )
    most = max(len(place) for _, _, place, _ in found)
    index, fraction = np.zeros((len(found), most), int), np.zeros((len(found), most))
    measured = np.zeros((len(found), most, len(channels)))
    trust = np.zeros_like(measured)
    for row, (_, _, place, values) in enumerate(found):
        m = len(place)
        index[row, :m] = np.minimum(np.floor(place + 1e-9), steps)
        fraction[row, :m] = np.maximum(place - index[row, :m], 0.0)
        seen = np.isfinite(values)
        measured[row, :m], trust[row, :m] = np.where(seen, values, 0.0), seen
    inputs = np.stack([held for _, held, _, _ in found])
    record = np.array([number for number, *_ in found])
    unit = Noise.of(np.ones(len(channels)))
    windows = Windows(dt, tuple(channels), inputs, index, fraction, measured, trust, unit, record)
    return windows.with_noise(noise if noise is not None else Noise.of(rough_noise(windows)))


def rough_noise(windows: Windows) -> Floats:
    """White noise (C,) of each channel from third differences of neighbouring samples.

    Raises:
        ValueError: for a channel that never changes, which measures nothing.
    """
    noise = np.empty(len(windows.channels))
    for column, channel in enumerate(windows.channels):
        series = windows.measured[..., column]
        if channel.angular:
            series = np.unwrap(series, axis=1)
        rows = zip(series, windows.trust[..., column] > 0, strict=True)
        third = np.concatenate([np.zeros(0), *(np.diff(values[seen], 3) for values, seen in rows)])
        size = MEDIAN_TO_DEVIATION * float(np.median(np.abs(third))) / THIRD_DIFFERENCE if len(third) else 0.0
        if not size > 0:
            raise ValueError(f"{channel.name} never changes, or was written too coarsely: leave the channel out")
        noise[column] = size
    return noise


def _whitening(times: Floats, trust: Floats, noise: Noise) -> Floats:
    """Lower triangles (W, C, m, m) that make the errors of samples independent and of size one."""
    age = np.abs(times[:, :, None] - times[:, None])
    share = np.exp(-age / noise.time)[:, None] * ((noise.drift / noise.white) ** 2)[:, None, None]
    seen = np.moveaxis(trust, 1, 2)
    covariance = np.eye(times.shape[1]) + share * seen[..., None] * seen[..., None, :]
    return np.linalg.inv(np.linalg.cholesky(covariance))
