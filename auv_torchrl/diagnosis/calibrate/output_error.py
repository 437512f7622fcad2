"""Coefficients are fitted to windows that are simulated from their starts, by the commands alone.

The fit minimises the output error (Ljung 1999, section 3.2) instead of the innovations of the search. Where a vehicle's
file is a guess, predictions over seconds count, and the error is the model's, not the sensors'.

Commands of one size leave a bent valley, along which gains of thrusters and the exponent of their curve trade. Moments
leave another one, of gains and arms. Straight steps along such a valley leave it soon. Each step is therefore tried
again, corrected by what slopes do not tell of it (after geodesic acceleration, Transtrum and Sethna 2012). Heavy and
light vehicles that answer the same lie in valleys of their own. The descent therefore begins at several places, and the
end with the largest posterior stands.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from auv_torchrl.diagnosis.calibrate.parameters import Coefficient, shared_covariance
from auv_torchrl.diagnosis.identify.hypotheses import Values, batch
from auv_torchrl.diagnosis.motion.actuation import actuate
from auv_torchrl.diagnosis.motion.rollout import fly
from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.diagnosis.thresholds import FLEW_OFF, HUBER
from auv_torchrl.effects import EFFECTS
from auv_torchrl.flightlog import POSE
from auv_torchrl.sysid.bounded import least_within
from auv_torchrl.sysid.windows import MEDIAN_TO_DEVIATION
from auv_torchrl.vehicle import Vehicle

START_WIDTH = np.array([0.1] * 6 + [0.1] * 3 + [0.3] * 3)  # m, rad, m/s, rad/s, of a start about its guess
UNSEEN_BY_VELOCITY = (0, 1, 2, 5)  # position and yaw
SMALLEST = 1e-6  # least scale of a channel, where the prediction is exact
STEP = 1e-3  # of a coefficient's width, for slopes
ROUGH_STEP = 0.2  # likewise of a threshold, which switches single samples: enough of them must do so to make a slope
DAMPING = (1e-6, 1e-3, 3e-2, 1.0)  # tried side by side in every round
# Of each step, by what slopes do not tell of it. For 50 of 100 vehicles whose files are wrong by 40 %, chi-square ended
# higher by 1000 than it need be without any, for 22 with one, 8 with two, 6 with three; in 0.5 s, and 0.6 s with some.
CORRECTIONS = 3
ROUNDS = 40
SETTLED = 0.4  # chi-square by which a round must improve: a smaller fall moves no coefficient by its error
NEARLY_SETTLED = 2.0  # likewise where only the prediction of unseen windows counts
ALONE = 1e-6  # of a variance, by which independent numbers may seem to share it
# Standard deviations along the widest direction of the prior, the strength of all thrusters, from which descents begin:
# the file, and a vehicle so weak that it stays near the log. A vehicle that is too strong flies off at once.
BEGINS = (0.0, -np.sqrt(3.0))


@dataclass(frozen=True)
class CoefficientFit:
    """The likeliest coefficients, and their covariance by data and prior."""

    values: Floats  # (k,)
    covariance: Floats  # (k, k)
    scale: Floats  # (C,) robust standard deviation of the errors, by channel that is used


def used_channels(windows: Windows) -> np.ndarray:
    """Columns of the channels to fit: velocities, and poses whose velocity is not measured."""
    here = set(windows.channels)
    together = {"x": "uv", "y": "uv", "z": "w", "roll": "p", "pitch": "q", "yaw": "r"}
    return np.array([i for i, c in enumerate(windows.channels) if not (c in together and set(together[c]) <= here)])


def simulate_errors(windows: Windows, vehicle: Vehicle, rows: list[Values], starts: Floats | None = None) -> Floats:
    """Measured less predicted samples (R, W, m, C) of the used channels, for each row of effect values.

    ``starts`` (W, R or 1, 12) are those of the windows; None for their guesses.
    """
    begin = windows.guess[:, None] if starts is None else starts
    predicted, _ = fly(actuate(windows, batch(vehicle, rows)), begin)
    error = windows.residual(predicted)
    return np.moveaxis(error[..., used_channels(windows)], 1, 0)


def as_values(coefficients: Sequence[Coefficient], at: Floats) -> Values:
    """Effect values of coefficients that have the values ``at`` (k,)."""
    values: Values = {}
    for c, value in zip(coefficients, at.tolist(), strict=True):
        values.setdefault(c.effect, {})[c.member] = value
    return values


def measure_scale(windows: Windows, error: Floats) -> tuple[Floats, float]:
    """Robust standard deviation (C,) of errors (W, m, C), and over how many samples they are correlated.

    All channels have one number of samples. Otherwise a channel that drifts slowly while no command excites it would
    weigh next to nothing while a command does.
    """
    seen = windows.trust[..., used_channels(windows)] > 0
    inside = np.where(seen, np.where(np.isfinite(error), error, np.inf), np.nan)
    inside = inside[seen.any(-1)]
    middle = MEDIAN_TO_DEVIATION * np.nanmedian(np.abs(inside), axis=0)
    cut = np.clip(inside, -3 * middle, 3 * middle)
    scale = np.maximum(np.maximum(np.sqrt(np.nanmean(cut**2, axis=0)), middle), SMALLEST)
    # first-order correlation of neighbours: (1 + rho) / (1 - rho) samples say as much as one
    near = (seen[:, 1:] & seen[:, :-1]).any(-1)
    clipped = np.clip(np.nan_to_num(error), -3 * scale, 3 * scale)
    now, then = clipped[:, 1:][near], clipped[:, :-1][near]
    rho = np.clip((now * then).mean(0) / (0.5 * (now**2 + then**2)).mean(0).clip(SMALLEST**2), 0.0, 0.98)
    return scale, float(np.median((1 + rho) / (1 - rho)))


def pseudo_huber(error: Floats, scale: Floats) -> Floats:
    """Numbers whose squares grow like those of ``error / scale`` while it is small, and linearly beyond."""
    r = np.clip(np.nan_to_num(error / scale, nan=FLEW_OFF, posinf=FLEW_OFF, neginf=-FLEW_OFF), -FLEW_OFF, FLEW_OFF)
    return np.sign(r) * HUBER * np.sqrt(2 * (np.sqrt(1 + (r / HUBER) ** 2) - 1))


def _free_start_entries(windows: Windows, vehicle: Vehicle) -> np.ndarray:
    """Which of the 12 numbers of a start are free: those that the used channels show."""
    moves = np.flatnonzero(vehicle.free > 0)
    entries = np.concatenate([moves, moves + 6])
    poses = any(windows.channels[i] in POSE for i in used_channels(windows))
    return entries if poses else np.setdiff1d(entries, UNSEEN_BY_VELOCITY)


def _weigh(windows: Windows, error: Floats, scale: Floats, memory: float) -> Floats:
    """Numbers (R, W, m C) whose squares add up to the cost of errors (R, W, m, C)."""
    r = pseudo_huber(error, scale) * windows.present[..., None] / np.sqrt(memory)
    return r.reshape(*r.shape[:2], -1)


@dataclass(frozen=True)
class _Slopes:
    """How weighed errors (W, n) change with coefficients (k,) and with the starts of windows; these are eliminated."""

    by_coefficients: Floats  # (k, W, n)
    by_starts: Floats  # (W, L, n)
    start_precision: Floats  # (L,)

    @property
    def _flat(self) -> Floats:
        """Those by coefficients, (k, W n)."""
        return self.by_coefficients.reshape(len(self.by_coefficients), -1)

    @cached_property
    def cross(self) -> Floats:
        """Curvature (W, L, k) in starts and coefficients."""
        return self.by_starts @ self.by_coefficients.transpose(1, 2, 0)

    @cached_property
    def gram(self) -> Floats:
        """Curvature (W, L, L) in the start of each window."""
        return self.by_starts @ self.by_starts.mT + np.diag(self.start_precision)

    @cached_property
    def response(self) -> Floats:
        """By how much (W, L, k) starts go down where coefficients go up."""
        return np.linalg.solve(self.gram, self.cross)

    @cached_property
    def curvature(self) -> Floats:
        """Curvature (k, k) in the coefficients alone, as the starts follow them."""
        k = len(self.by_coefficients)
        found: Floats = self._flat @ self._flat.T - self.cross.reshape(-1, k).T @ self.response.reshape(-1, k)
        return 0.5 * (found + found.T)

    def eliminate(self, errors: Floats, away: Floats | float = 0.0) -> tuple[Floats, Floats]:
        """The gradient (k,) that errors (W, n) make, and by how much (W, L) the starts are off for them.

        ``away`` (W, L) is how far the starts are from their guesses.
        """
        pull = (self.by_starts @ errors[..., None])[..., 0] + away * self.start_precision
        offset = np.linalg.solve(self.gram, pull[..., None])[..., 0]
        taken = self.cross.reshape(-1, len(self.by_coefficients)).T @ offset.ravel()
        return self._flat @ errors.ravel() - taken, offset

    def along(self, step: "_Step") -> Floats:
        """The change (W, n) of the errors in a step, as far as slopes tell."""
        by_starts: Floats = np.einsum("wl,wln->wn", step.starts, self.by_starts)
        return np.tensordot(step.coefficients, self.by_coefficients, 1) + by_starts


@dataclass(frozen=True)
class _Linearisation:
    """Errors at coefficients (k,) and starts (W, 12), with their slopes."""

    at: Floats  # (k,)
    start: Floats  # (W, 12)
    error: Floats  # (W, m, C)
    scale: Floats  # (C,)
    memory: float  # samples
    weighed: Floats  # (W, n) errors
    slopes: _Slopes
    curvature: Floats  # (k, k) with the prior
    gradient: Floats  # (k,)
    offset: Floats  # (W, L) by which the starts are off at these coefficients


@dataclass(frozen=True)
class _Step:
    """A change of coefficients (k,) and of the free numbers of starts (W, L)."""

    coefficients: Floats
    starts: Floats


class Descent:
    """Levenberg-Marquardt within the bounds; the prior is as wide as the coefficients are uncertain.

    Each window starts near its guess, at the start that suits the coefficients. Every round measures the scale of each
    channel and the correlation of the errors anew. Neither a channel that no coefficient explains nor a thousand
    samples of one slow error then outweigh the prior.
    """

    def __init__(self, windows: Windows, vehicle: Vehicle, coefficients: Sequence[Coefficient]):
        self.windows, self.vehicle, self.coefficients = windows, vehicle, coefficients
        self.nominal, self.width, self.low, self.high = np.array(
            [(c.nominal, c.width, c.low, c.high) for c in coefficients]
        ).T
        self.covariance = shared_covariance([(c.effect, c.member) for c in coefficients], self.width)
        self.precision = np.linalg.inv(self.covariance)
        self.reach = self.width * np.where([EFFECTS[c.effect].trial.is_rough for c in coefficients], ROUGH_STEP, STEP)
        self.entries = _free_start_entries(windows, vehicle)
        self.start_width = START_WIDTH[self.entries]

    def starting_points(self) -> list[Floats]:
        """Coefficients (k,) from which to descend: those of the file, and along the widest direction of the prior."""
        sizes, directions = np.linalg.eigh(self.covariance / np.outer(self.width, self.width))
        if sizes[-1] <= 1 + ALONE:
            return [self.nominal]
        along = directions[:, -1] * self.width
        along = along * np.sign(along.sum())  # eigenvectors have either sign
        one = along / np.sqrt(along @ self.precision @ along)
        return [np.clip(self.nominal + step * one, self.low, self.high) for step in BEGINS]

    def descend(self, begin: Floats, settled: float = SETTLED) -> _Linearisation:
        """The end of the descent from coefficients (k,): a round there lowers chi-square by less than ``settled``."""
        at, start = begin, self.windows.guess
        for _ in range(ROUNDS):
            here = self.linearise(at, start)
            at, start, falls = self.step(here)
            if falls < settled:
                return here
        return self.linearise(at, start)

    def linearise(self, at: Floats, start: Floats) -> _Linearisation:
        """Errors and their slopes at coefficients (k,) and starts (W, 12)."""
        k, entries, loose, windows = len(at), self.entries, self.start_width, self.windows
        step = np.where(at + self.reach > self.high, -self.reach, self.reach)
        points = [at, *(at + step * unit for unit in np.eye(k)), *[at] * len(entries)]
        starts = np.repeat(start[:, None], len(points), axis=1)
        starts[:, np.arange(1 + k, len(points)), entries] += STEP * loose
        error = self._errors(points, starts)
        scale, memory = measure_scale(windows, error[0])
        r = _weigh(windows, error, scale, memory)
        slope = (r[1 : 1 + k] - r[0]) / step[:, None, None]
        local = (r[1 + k :] - r[0]) / (STEP * loose)[:, None, None]
        slopes = _Slopes(slope, np.moveaxis(local, 0, 1), loose**-2.0)
        gradient, offset = slopes.eliminate(r[0], (start - windows.guess)[:, entries])
        gradient += self.precision @ (at - self.nominal)
        curvature = slopes.curvature + self.precision
        return _Linearisation(at, start, error[0], scale, memory, r[0], slopes, curvature, gradient, offset)

    def step(self, here: _Linearisation) -> tuple[Floats, Floats, float]:
        """Coefficients (k,) and starts (W, 12) of the best of several steps, and by how much it lowers the cost."""
        steps = straight = [self._towards(here, damping, here.gradient, here.offset) for damping in DAMPING]
        tried = ends = self._ends(here, steps)
        for _ in range(CORRECTIONS):
            each = zip(DAMPING, straight, steps, ends, strict=True)
            steps = [self._corrected(here, damping, first, step, end[-1]) for damping, first, step, end in each]
            ends = self._ends(here, steps)
            tried = tried + ends
        costs = [self.cost(error, at, start, here.scale, here.memory) for at, start, error in tried]
        best = int(np.argmin(costs))
        at, start, _ = tried[best]
        return at, start, self.cost(here.error, here.at, here.start, here.scale, here.memory) - costs[best]

    def _towards(
        self, here: _Linearisation, damping: float, gradient: Floats, offset: Floats, behind: _Step | None = None
    ) -> _Step:
        """The damped step within the bounds against a gradient (k,) and an offset (W, L), from the end of another."""
        at = here.at if behind is None else here.at + behind.coefficients
        stuck = ((here.at <= self.low) & (here.gradient > 0)) | ((here.at >= self.high) & (here.gradient < 0))
        damped = here.curvature + damping * np.diag(np.diag(here.curvature))
        change = least_within(damped, -gradient, (self.low - at, self.high - at), np.eye(len(at))[:, ~stuck])
        return _Step(change, -offset - here.slopes.response @ change)

    def _corrected(self, here: _Linearisation, damping: float, first: _Step, step: _Step, error: Floats) -> _Step:
        """The first step, with what makes up for how errors (W, m, C) behind ``step`` differ from what slopes tell."""
        bend = _weigh(self.windows, error[None], here.scale, here.memory)[0] - here.weighed - here.slopes.along(step)
        more = self._towards(here, damping, *here.slopes.eliminate(bend), first)
        return _Step(first.coefficients + more.coefficients, first.starts + more.starts)

    def _ends(self, here: _Linearisation, steps: Sequence[_Step]) -> list[tuple[Floats, Floats, Floats]]:
        """Coefficients (k,), starts (W, 12) and errors (W, m, C) behind each step."""
        points = [np.clip(here.at + step.coefficients, self.low, self.high) for step in steps]
        starts = np.repeat(here.start[:, None], len(steps), axis=1)
        starts[..., self.entries] += np.stack([step.starts for step in steps], axis=1)
        return list(zip(points, starts.swapaxes(0, 1), self._errors(points, starts), strict=True))

    def cost(self, error: Floats, at: Floats, start: Floats, scale: Floats, memory: float) -> float:
        """Chi-square of errors (W, m, C), of coefficients (k,) and of starts (W, 12)."""
        r = _weigh(self.windows, error[None], scale, memory)
        moved = (start - self.windows.guess)[:, self.entries] / self.start_width
        return float((r**2).sum() + (at - self.nominal) @ self.precision @ (at - self.nominal) + (moved**2).sum())

    def deviance(self, end: _Linearisation, memory: float) -> float:
        """Minus twice the log posterior of an end, with errors that are correlated over ``memory`` samples.

        The cost alone compares nothing: each end measures the scale of its own errors, so its cost is one per sample.
        """
        seen = (self.windows.trust[..., used_channels(self.windows)] > 0).sum((0, 1))
        cost = self.cost(end.error, end.at, end.start, end.scale, memory)
        return cost + float(2 * (seen * np.log(end.scale)).sum() / memory)

    def _errors(self, points: Sequence[Floats], starts: Floats) -> Floats:
        rows = [as_values(self.coefficients, point) for point in points]
        return simulate_errors(self.windows, self.vehicle, rows, starts)


def fit_coefficients(
    windows: Windows,
    vehicle: Vehicle,
    coefficients: Sequence[Coefficient],
    begins: Sequence[Floats] = (),
    settled: float = SETTLED,
) -> CoefficientFit:
    """The likeliest end of descents.

    Args:
        windows: of a log.
        vehicle: as its file says, empty batch.
        coefficients: to fit, with their priors.
        begins: coefficients (k,) from which to descend; empty for :meth:`Descent.starting_points`.
        settled: fall of chi-square in a round, below which a descent ends.
    """
    descent = Descent(windows, vehicle, coefficients)
    ends = [descent.descend(begin, settled) for begin in begins or descent.starting_points()]
    memory = min(end.memory for end in ends)
    best = min(ends, key=lambda end: descent.deviance(end, memory))
    return CoefficientFit(best.at, np.linalg.inv(best.curvature), best.scale)
