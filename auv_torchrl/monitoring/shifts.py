"""When a series of values changed: steps and drifts from some dive on, by generalized likelihood ratios.

A change of one parameter at dive m is a step (from m on the parameter has another value) or a drift (from m on the
parameter moves by the same in each dive). The level before the change is not known either: the dives before show it.
Twice the log likelihood ratio of the best size of such a change is its *gain*. An alarm is raised when the largest gain
over all parameters, moments and kinds passes a threshold (Lorden 1971, Siegmund and Venkatraman 1995).
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from auv_torchrl.diagnosis.motion.windows import Floats

HORIZON, PATHS, SEED = 100, 4000, 0  # dives and healthy series, from which the threshold is simulated
TAIL = (0.2, 0.01)  # of these series pass: the tail beyond follows from that between, log share linear in the threshold
TAIL_POINTS = 12
MOST_SHIFTS = 3  # of one parameter
DRIFT_DIVES = 10.0  # in which a drift goes as far as a step, before anything is seen
NEGLIGIBLE = 1e-9


@dataclass(frozen=True)
class Candidates:
    """Changes that a series of n dives may have: the shape (m, n) of each, and the dive where it begins."""

    shape: Floats
    begin: np.ndarray  # (m,)
    is_drift: np.ndarray  # (m,)


@dataclass(frozen=True)
class Shift:
    """A change of one parameter."""

    is_drift: bool
    begin: int  # the first dive that is not as before, from 0
    low: int  # 95 % interval of that
    high: int
    size: float  # of a step; of a drift, per dive
    deviation: float  # standard deviation of the size
    gain: float
    probability: float

    def at(self, dives: np.ndarray) -> Floats:
        """What it adds in some dives, by number from 0."""
        since = np.maximum(dives - self.begin + 1.0, 0.0)
        return self.size * (since if self.is_drift else np.minimum(since, 1.0))


@cache
def candidates(n: int, reference: int) -> Candidates:
    """Changes that begin behind the reference dives."""
    begin = np.arange(max(reference, 1), n)
    since = np.maximum(np.arange(n) - begin[:, None] + 1.0, 0.0)
    drifts = since[:-1]  # one that begins with the last dive is a step
    shape = np.concatenate([np.minimum(since, 1.0), drifts])
    return Candidates(shape, np.append(begin, begin[:-1]), np.repeat([False, True], [len(begin), len(begin[:-1])]))


def gains(value: Floats, variance: Floats, reference: int) -> Floats:
    """Gain (K, m) of each candidate in K series of n dives; the level before is fitted."""
    shape = candidates(value.shape[1], reference).shape
    weight = 1.0 / variance
    total = np.maximum(weight.sum(1, keepdims=True), NEGLIGIBLE)
    centred = value - (weight * value).sum(1, keepdims=True) / total
    along = (weight * centred) @ shape.T
    left = weight @ (shape**2).T - (weight @ shape.T) ** 2 / total
    seen = left > NEGLIGIBLE * np.maximum(weight @ (shape**2).T, NEGLIGIBLE)
    return np.where(seen, along**2 / np.where(seen, left, 1.0), 0.0)


@cache
def threshold(parameters: int, reference: int, dives_per_false_alarm: float) -> float:
    """The gain that a healthy vehicle passes once in so many dives, in whichever of its parameters.

    Found by simulating series without a change, with a fixed seed; parameters count as independent, which can only make
    alarms rarer.
    """
    wanted = HORIZON / (dives_per_false_alarm * max(parameters, 1))
    noise = np.random.default_rng(SEED).standard_normal((PATHS, HORIZON))
    largest = np.zeros(PATHS)
    for n in range(reference + 1, HORIZON + 1):
        own = noise[:, :n]
        largest = np.maximum(largest, gains(own, np.ones_like(own), reference).max(1))
    share = np.geomspace(*TAIL, TAIL_POINTS)
    slope, offset = np.polyfit(np.log(share), np.quantile(largest, 1 - share), 1)
    return float(offset + slope * np.log(min(wanted, TAIL[0])))


def shifts(
    value: Floats, variance: Floats, reference: int, least_gain: float, width: float, odds: float
) -> list[Shift]:
    """Changes of one parameter over n dives, the largest first, as long as each gains enough.

    Args:
        value: (n,) deviations from the reference.
        variance: (n,) infinite where a dive has no information.
        reference: dives that are known to be healthy.
        least_gain: of a change.
        width: standard deviation of the size of a step, before anything is seen.
        odds: prior odds that this parameter changes at a given dive.
    """
    every, n = candidates(len(value), reference), len(value)
    root = np.where(np.isfinite(variance), 1 / np.sqrt(np.maximum(variance, NEGLIGIBLE**2)), 0.0)
    beside: list[Floats] = [np.ones(n)]
    chosen: list[tuple[int, Floats, Floats]] = []
    while len(chosen) < MOST_SHIFTS and len(every.begin):
        gain, information = _gains_beside(value, root, every.shape, beside)
        best = int(gain.argmax())
        if gain[best] < least_gain:
            break
        chosen.append((best, gain, information))
        beside.append(every.shape[best])
    if not chosen:
        return []
    design = np.stack(beside, 1) * root[:, None]
    covariance = np.linalg.pinv(design.T @ design)
    sizes = covariance @ design.T @ (root * value)
    found = []
    for i, (best, gain, information) in enumerate(chosen, start=1):
        prior = np.where(every.is_drift, width / DRIFT_DIVES, width) ** 2
        factor = _log_bayes_factor(gain, information, prior)
        low, high, probability = _moment(factor, every.begin, odds)
        begin = int(every.begin[best])
        spread = float(np.sqrt(covariance[i, i]))
        low, high = min(low, begin), max(high, begin)
        found.append(
            Shift(bool(every.is_drift[best]), begin, low, high, float(sizes[i]), spread, float(gain[best]), probability)
        )
    return found


def _gains_beside(value: Floats, root: Floats, shape: Floats, beside: list[Floats]) -> tuple[Floats, Floats]:
    """Gain and information (m,) of candidates where other changes are fitted beside each."""
    q, _ = np.linalg.qr(np.stack(beside, 1) * root[:, None])
    scaled, y = shape * root, value * root
    own, left = scaled - (scaled @ q) @ q.T, y - q @ (q.T @ y)
    information = (own**2).sum(1)
    seen = information > NEGLIGIBLE * np.maximum((scaled**2).sum(1), NEGLIGIBLE)
    return np.where(seen, (own @ left) ** 2 / np.where(seen, information, 1.0), 0.0), np.where(seen, information, 0.0)


def _log_bayes_factor(gain: Floats, information: Floats, prior: Floats) -> Floats:
    """Log odds that each candidate gains over no change, its size drawn from a normal prior."""
    ratio = prior * information
    return 0.5 * (gain * ratio / (1 + ratio) - np.log1p(ratio))


def _moment(log_factor: Floats, begin: np.ndarray, odds: float) -> tuple[int, int, float]:
    """95 % interval of the dive at which a change begins, and the probability that there is one."""
    top = log_factor.max()
    weight = np.exp(log_factor - top)
    moments = np.unique(begin)
    mass = np.array([weight[begin == moment].sum() for moment in moments])
    cumulated = np.cumsum(mass) / mass.sum()
    low, high = (int(moments[np.searchsorted(cumulated, q)]) for q in (0.025, 0.975))
    log_odds = np.log(odds * weight.sum() / 2) + top  # steps and drifts share the odds
    return low, high, float(1 / (1 + np.exp(-log_odds))) if log_odds < 700 else 1.0
