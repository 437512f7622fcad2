"""Windows simulated from their starts under their disturbances: what is predicted, and what is left of the samples."""

from dataclasses import dataclass

import numpy as np

from auv_torchrl.sysid.model import Floats, Model, wrapped
from auv_torchrl.sysid.windows import Disturbance, Windows

GUESS_SAMPLES = 5  # of a window, through which a parabola gives value and rate of each channel at its start
GUESS_ROUNDS = 4  # of Gauss-Newton for the state that shows these values and rates
STEP = 1e-4  # of a standard deviation: what a state or a force is moved by to see what that changes


@dataclass(frozen=True)
class Problem:
    """A model, the windows it should explain, and the disturbance that may act in them.

    The free numbers of a window are its start and a force for each bin: ``L = n + B f``.
    """

    model: Model
    windows: Windows
    disturbance: Disturbance
    guess: Floats  # (W, n) about which starts lie

    @staticmethod
    def of(model: Model, windows: Windows, disturbance: Disturbance, values: Floats | None = None) -> "Problem":
        """The problem with starts guessed from the samples, for a model of ``values`` (P,), by default nominal."""
        return Problem(model, windows, disturbance, guess_starts(model, windows, _or_nominal(model, values)))

    @property
    def steps_per_bin(self) -> int:
        """Grid steps over which a force is held."""
        return max(1, round(self.disturbance.bin_s / self.windows.dt))

    @property
    def bins(self) -> int:
        """Bins of a window."""
        return -(-self.windows.steps // self.steps_per_bin)

    @property
    def states(self) -> int:
        """Numbers of a state."""
        return len(self.model.start_width)

    def precision(self, size: Floats) -> Floats:
        """Inverse prior covariance (L, L) of the free numbers, for a force of standard deviation ``size`` (f,)."""
        age = np.arange(self.bins) * self.steps_per_bin * self.windows.dt
        together = np.exp(-np.abs(age[:, None] - age) / self.disturbance.time)
        force = np.kron(np.linalg.inv(together), np.diag(size**-2.0))
        precision = np.zeros((self.states + len(force),) * 2)
        precision[: self.states, : self.states] = np.diag(self.model.start_width**-2.0)
        precision[self.states :, self.states :] = force
        return precision

    def away(self, start: Floats, bins: Floats) -> Floats:
        """Free numbers (W, L) of starts (W, n) and forces (W, B, f), less what their prior expects."""
        return np.concatenate([self.model.difference(start, self.guess), bins.reshape(len(bins), -1)], axis=1)

    def held(self, bins: Floats) -> Floats:
        """Force (W, S, f) in each step of bins (W, B, f)."""
        return np.repeat(bins, self.steps_per_bin, axis=1)[:, : self.windows.steps]

    def calm(self) -> Floats:
        """Bins (W, B, f) without a force."""
        return np.zeros((len(self.windows), self.bins, len(self.model.force_width)))

    def simulate(self, values: Floats, start: Floats, bins: Floats) -> "Path":
        """Where a model of ``values`` (P,) goes."""
        with np.errstate(over="ignore", invalid="ignore"):  # what diverges predicts NaN and is refused by its cost
            states = self.model.simulate(values[None], start[:, None], self.windows.inputs, self.held(bins)[:, None])
            predicted = self.windows.at_samples(self.model.observe(values[None], states))
            return Path(values, start, bins, states[:, 0], self.windows.residual(predicted)[..., 0])


@dataclass(frozen=True)
class Path:
    """A simulation of all windows."""

    values: Floats  # (P,)
    start: Floats  # (W, n)
    bins: Floats  # (W, B, f)
    states: Floats  # (W, S + 1, n) on the grid
    residual: Floats  # (W, K) measured less predicted, in units of the noise

    def chi2(self, problem: Problem, precision: Floats) -> Floats:
        """Chi-square (W,) of samples and free numbers together; infinite where the simulation diverged."""
        away = problem.away(self.start, self.bins)
        cost = (self.residual**2).sum(1) + ((away @ precision) * away).sum(1)
        return np.where(np.isfinite(cost), cost, np.inf)


def guess_starts(model: Model, windows: Windows, values: Floats) -> Floats:
    """(W, n) states that show what the first samples of each window show: value and rate of every channel.

    Entries of a state that neither shows stay 0.
    """
    n, zero = len(model.start_width), np.zeros((len(windows), 1, len(model.force_width)))
    level, rate, error = _first_values(windows)
    goal = np.concatenate([level, rate], axis=1)
    weight = 1.0 / error
    inputs = windows.inputs[:, :1]

    def shown(start: Floats) -> Floats:
        after = model.advance(values[None], start[:, None], inputs, zero)[:, 0]
        pair = model.observe(values[None], np.concatenate([start[:, None], after], axis=1)[:, None])[:, 0]
        return np.concatenate([pair[:, 0], _unwrapped(model, pair[:, 1] - pair[:, 0]) / model.dt], axis=1)

    def missing(there: Floats) -> Floats:
        left = goal - there
        left[:, : len(model.channels)] = _unwrapped(model, left[:, : len(model.channels)])
        return left

    start = np.zeros((len(windows), n))
    for _ in range(GUESS_ROUNDS):
        here = shown(start)
        slope = np.empty((*here.shape, n))
        for entry in range(n):
            moved = start.copy()
            moved[:, entry] += STEP * model.start_width[entry]
            slope[..., entry] = (shown(moved) - here) / (STEP * model.start_width[entry])
        scaled = slope * weight[..., None]
        gram = scaled.swapaxes(1, 2) @ scaled + np.diag(model.start_width**-2.0)
        pull = (scaled.swapaxes(1, 2) @ (missing(here) * weight)[..., None])[..., 0] - start * model.start_width**-2.0
        start = start + np.linalg.solve(gram, pull[..., None])[..., 0]
    return start


def _first_values(windows: Windows) -> tuple[Floats, Floats, Floats]:
    """Value (W, C) and rate (W, C) of each channel at the start of its window, and errors (W, 2 C) of both."""
    count, channels = len(windows), len(windows.channels)
    level, rate, error = np.zeros((count, channels)), np.zeros((count, channels)), np.full((count, 2 * channels), 1e9)
    for row in range(count):
        for column, channel in enumerate(windows.channels):
            seen = np.flatnonzero(windows.trust[row, :, column] > 0)[:GUESS_SAMPLES]
            if len(seen) < 3:
                continue
            times, values = windows.times[row, seen], windows.measured[row, seen, column]
            values = np.unwrap(values) if channel.angular else values
            powers = times[:, None] ** np.arange(3)
            parabola = np.linalg.lstsq(powers, values, rcond=None)[0]
            spread = np.sqrt(np.abs(np.diag(np.linalg.pinv(powers.T @ powers))))[:2]
            level[row, column], rate[row, column] = parabola[:2]
            error[row, [column, channels + column]] = spread * windows.noise.white[column]
    return level, rate, error


def _unwrapped(model: Model, change: Floats) -> Floats:
    """Changes (W, C) of reports, those of angles in (-pi, pi]."""
    angular = [channel.angular for channel in model.channels]
    return np.where(angular, wrapped(change), change)


def _or_nominal(model: Model, values: Floats | None) -> Floats:
    return model.nominal if values is None else values
