"""Fit many coefficients at once: simulate windows from their starts and shrink what is left.

Commands of one size leave a bent valley, along which gains of thrusters and the exponent of their curve trade, and
heavy and light vehicles that answer alike lie in valleys of their own. So the descent begins at several places, and
what is kept is what the samples and the prior make likeliest.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auv_torchrl.diagnosis.calibrate.output_error import (
    START_WIDTH,
    Fitted,
    as_values,
    errors,
    measure_scale,
    scaled,
    start_entries,
    used_channels,
)
from auv_torchrl.diagnosis.calibrate.uncertainty import Coefficient, shared_covariance
from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.effects import EFFECTS
from auv_torchrl.sysid.bounded import least_within
from auv_torchrl.vehicle import Vehicle

STEP = 1e-3  # of a coefficient's width, for slopes
ROUGH_STEP = 0.2  # likewise of a threshold, which switches single samples: enough of them must do so to make a slope
DAMPING = (1e-6, 1e-3, 3e-2, 1.0)  # tried side by side in every round
ROUNDS = 40
SETTLED = 0.4  # chi-square by which a round must lower what is left: less moves no coefficient by its error ...
NEARLY_SETTLED = 2.0  # ... and less than this tells nothing of how well windows are predicted that a fit does not see
ALONE = 1e-6  # of a variance, by which a prior of numbers that are alone may seem to share it
# Standard deviations along what the prior leaves open most, which is how strong thrusters are, from where descents
# begin: the file, and a vehicle so weak that it stays near what was flown. One that is too strong flies off at once.
BEGINS = (0.0, -np.sqrt(3.0))


@dataclass(frozen=True)
class _Slopes:
    """What is left at coefficients (k,) and starts (W, 12), and how it changes with both; starts are eliminated."""

    at: Floats  # (k,)
    start: Floats  # (W, 12)
    left: Floats  # (W, m, C)
    scale: Floats  # (C,)
    memory: float  # samples
    curvature: Floats  # (k, k)
    gradient: Floats  # (k,)
    response: Floats  # (W, L, k) of the starts to the coefficients
    offset: Floats  # (W, L) by which the starts are off as it is


class Descent:
    """Levenberg-Marquardt within the bounds, priors as wide as coefficients are uncertain.

    Each window starts near its guess, where the coefficients want it. The scale of each channel and the correlation of
    the errors are measured anew in every round, so that neither a channel that no coefficient explains nor a thousand
    samples of one slow error outweigh the prior.
    """

    def __init__(self, windows: Windows, vehicle: Vehicle, coefficients: Sequence[Coefficient]):
        self.windows, self.vehicle, self.coefficients = windows, vehicle, coefficients
        self.nominal, self.width, self.low, self.high = np.array(
            [(c.nominal, c.width, c.low, c.high) for c in coefficients]
        ).T
        self.covariance = shared_covariance([(c.effect, c.member) for c in coefficients], self.width)
        self.known = np.linalg.inv(self.covariance)
        self.reach = self.width * np.where([EFFECTS[c.effect].is_rough for c in coefficients], ROUGH_STEP, STEP)
        self.entries = start_entries(windows, vehicle)
        self.loose = START_WIDTH[self.entries]

    def begins(self) -> list[Floats]:
        """Coefficients (k,) to begin from: those of the vehicle, and along what its file leaves open most."""
        sizes, directions = np.linalg.eigh(self.covariance / np.outer(self.width, self.width))
        if sizes[-1] <= 1 + ALONE:
            return [self.nominal]
        along = directions[:, -1] * self.width
        along = along * np.sign(along.sum())  # eigenvectors have either sign
        one = along / np.sqrt(along @ self.known @ along)
        return [np.clip(self.nominal + step * one, self.low, self.high) for step in BEGINS]

    def down(self, begin: Floats, settled: float = SETTLED) -> _Slopes:
        """Where the way down from coefficients (k,) ends: where a round lowers chi-square by less than ``settled``."""
        at, start = begin, self.windows.guess
        for _ in range(ROUNDS):
            slopes = self.slopes(at, start)
            at, start, falls = self.step(slopes)
            if falls < settled:
                return slopes
        return self.slopes(at, start)

    def slopes(self, at: Floats, start: Floats) -> _Slopes:
        """What is left at coefficients (k,) and starts (W, 12), with slopes."""
        k, entries, loose, windows = len(at), self.entries, self.loose, self.windows
        step = np.where(at + self.reach > self.high, -self.reach, self.reach)
        points = [at, *(at + step * unit for unit in np.eye(k)), *[at] * len(entries)]
        starts = np.repeat(start[:, None], len(points), axis=1)
        starts[:, np.arange(1 + k, len(points)), entries] += STEP * loose
        left = self._left(points, starts)
        scale, memory = measure_scale(windows, left[0])
        r = scaled(windows, left, scale, memory)
        slope = (r[1 : 1 + k] - r[0]) / step[:, None, None]
        local = (r[1 + k :] - r[0]) / (STEP * loose)[:, None, None]
        gram = np.einsum("lwn,mwn->wlm", local, local) + np.diag(loose**-2.0)
        cross = np.einsum("lwn,kwn->wlk", local, slope)
        pull = np.einsum("lwn,wn->wl", local, r[0]) + (start - windows.guess)[:, entries] / loose**2
        response, offset = np.linalg.solve(gram, cross), np.linalg.solve(gram, pull[..., None])[..., 0]
        curvature = np.einsum("iwn,jwn->ij", slope, slope) - np.einsum("wli,wlj->ij", cross, response)
        gradient = np.einsum("kwn,wn->k", slope, r[0]) - np.einsum("wlk,wl->k", cross, offset)
        gradient += self.known @ (at - self.nominal)
        curvature = 0.5 * (curvature + curvature.T) + self.known
        return _Slopes(at, start, left[0], scale, memory, curvature, gradient, response, offset)

    def step(self, slopes: _Slopes) -> tuple[Floats, Floats, float]:
        """Coefficients (k,) and starts (W, 12) of the best of several steps, and by how much it lowers the cost."""
        at, gradient = slopes.at, slopes.gradient
        free = ~(((at <= self.low) & (gradient > 0)) | ((at >= self.high) & (gradient < 0)))
        room, directions = (self.low - at, self.high - at), np.eye(len(at))[:, free]
        size = np.diag(np.diag(slopes.curvature))
        trials = [
            at + least_within(slopes.curvature + damping * size, -gradient, room, directions) for damping in DAMPING
        ]
        trials = [np.clip(trial, self.low, self.high) for trial in trials]
        starts = np.repeat(slopes.start[:, None], len(trials), axis=1)
        moves = [slopes.offset + slopes.response @ (trial - at) for trial in trials]
        starts[..., self.entries] -= np.stack(moves, axis=1)
        tried = self._left(trials, starts)
        now = self.cost(slopes.left, at, slopes.start, slopes.scale, slopes.memory)
        costs = [
            self.cost(tried[i], trial, starts[:, i], slopes.scale, slopes.memory) for i, trial in enumerate(trials)
        ]
        best = int(np.argmin(costs))
        return trials[best], starts[:, best], now - costs[best]

    def cost(self, left: Floats, at: Floats, start: Floats, scale: Floats, memory: float) -> float:
        """Chi-square of what is left (W, m, C), of coefficients (k,) and of starts (W, 12)."""
        r = scaled(self.windows, left[None], scale, memory)
        moved = (start - self.windows.guess)[:, self.entries] / self.loose
        return float((r**2).sum() + (at - self.nominal) @ self.known @ (at - self.nominal) + (moved**2).sum())

    def unlikelihood(self, ended: _Slopes, memory: float) -> float:
        """Minus twice the log posterior, errors being correlated over ``memory`` samples.

        The cost alone compares nothing: each end measures the scale of its own errors, and is one per sample by it.
        """
        seen = (self.windows.trust[..., used_channels(self.windows)] > 0).sum((0, 1))
        cost = self.cost(ended.left, ended.at, ended.start, ended.scale, memory)
        return cost + float(2 * (seen * np.log(ended.scale)).sum() / memory)

    def _left(self, points: Sequence[Floats], starts: Floats) -> Floats:
        return errors(self.windows, self.vehicle, [as_values(self.coefficients, point) for point in points], starts)


def fit(
    windows: Windows,
    vehicle: Vehicle,
    coefficients: Sequence[Coefficient],
    begins: Sequence[Floats] = (),
    settled: float = SETTLED,
) -> Fitted:
    """The likeliest end of descents from ``begins``, coefficients (k,), or from where :meth:`Descent.begins` says.

    They end where a round lowers chi-square by less than ``settled``.
    """
    descent = Descent(windows, vehicle, coefficients)
    ends = [descent.down(begin, settled) for begin in begins or descent.begins()]
    memory = min(end.memory for end in ends)
    best = min(ends, key=lambda end: descent.unlikelihood(end, memory))
    return Fitted(best.at, np.linalg.inv(best.curvature), best.scale)
