"""Notice that a vehicle has changed, by tests whose false-alarm rates are calculated, or that its map leads nowhere."""

import itertools
import math
from functools import cache
from typing import Any

import numpy as np
from scipy.special import chdtr, chdtri  # of chi-square; scipy.stats has them too, and takes a second to import

from auv_torchrl.adaptation.config import AdaptationConfig
from auv_torchrl.adaptation.filter import Innovation
from auv_torchrl.adaptation.memory import Memory
from auv_torchrl.adaptation.motion import Step
from auv_torchrl.quantities import counted

Array = Any
_CELLS = 120  # of the sum's range in the calculation of the run length
_LARGEST = 50  # caps; a test with a larger threshold would never see anything


class ChangeDetector:
    """Cumulative sum (Page 1954) of squared innovations, one per vehicle.

    While the estimate describes the vehicle, the squared innovation of m measured values is chi-square with m
    degrees of freedom, whatever the vehicle does. The sum grows by it less m + shift^2 / 2, never below 0; beyond
    :attr:`threshold` the vehicle has changed. The threshold gives the wanted mean time between false alarms, from
    the Markov chain of the sum (Brook and Evans 1972).

    Args:
        degrees: measured values per step.
        smallest_shift: norm of the shift of the innovation, in standard deviations, that the test is tuned for.
        steps_between_false_alarms: mean number of healthy steps between two alarms.
        capped_share: share of the healthy steps whose square is cut off.
    """

    def __init__(self, degrees: int, smallest_shift: float, steps_between_false_alarms: float, capped_share: float):
        self.reference = degrees + smallest_shift**2 / 2
        self.degrees = degrees
        self.cap = float(chdtri(degrees, capped_share))
        self.threshold = _threshold(degrees, self.reference, self.cap, steps_between_false_alarms)

    def advance(self, total: Array, square: Array, usable: Array) -> Array:
        """The sums (N,) after squared innovations (N,); rows that are not ``usable`` keep theirs."""
        grown = np.maximum(0.0, total + np.minimum(square, self.cap) - self.reference)
        return np.where(usable, grown, total)


@cache
def _threshold(degrees: int, reference: float, cap: float, steps: float) -> float:
    low = high = reference
    while 0 < _run_length(degrees, reference, cap, high) < steps:
        low, high = high, 1.25 * high
        if high > _LARGEST * cap:
            raise ValueError(
                f"detector: one false alarm in {steps:g} steps is not reached with a reference of {reference:g} for "
                f"{counted(degrees, 'value')}: give a larger smallest_shift"
            )
    for _ in range(20):
        middle = (low + high) / 2
        low, high = (middle, high) if _run_length(degrees, reference, cap, middle) < steps else (low, middle)
    return high


def _run_length(degrees: int, reference: float, cap: float, threshold: float) -> float:
    """Mean number of healthy steps until the sum, from 0, exceeds ``threshold``; not above 0 where numbers end."""
    width = threshold / _CELLS
    # from the centre of cell i a step ends below the upper edge of cell j; cell 0 takes all that is below it
    edge = (np.arange(-_CELLS, _CELLS) + 0.5) * width + reference
    below = np.where(edge < cap, chdtr(degrees, np.maximum(edge, 0.0)), 1.0)
    cell = np.arange(_CELLS)
    stay = np.diff(below[_CELLS + cell[None, :] - cell[:, None]], axis=1, prepend=0.0)
    return float(np.linalg.solve(np.eye(_CELLS) - stay, np.ones(_CELLS))[0])


class DeadEnd(Memory):
    """Standstill and circling of N vehicles with many of their thrusters at the limit.

    A wrong map can explain both: thrusters that push against each other, or that keep up a spin, do always the same,
    and from that nothing new is learnt.

    Args:
        count: number of vehicles N.
        limits: smallest and largest thrust (n,) of each thruster, shares of full thrust.
        control_dt: s.
        config: says how many thrusters, how still, how long, how far round.
    """

    stalled_s: Array  # (N,)
    turned: Array  # (N,) rad

    def __init__(self, count: int, limits: tuple[Array, Array], control_dt: float, config: AdaptationConfig):
        super().__init__()
        self.limits, self.control_dt, self.config = limits, control_dt, config
        self.remember(stalled_s=np.zeros(count), turned=np.zeros(count))

    def begin(self, rows: Array) -> None:
        """Some vehicles have a new map, or are somewhere else."""
        self.stalled_s[rows] = self.turned[rows] = 0.0

    def reached(self, share: Array, velocity: Array) -> Array:
        """Which vehicles are in one, (N,) bool, after a step with thrusts (N, n) that ended at velocities (N, D).

        The rate of turning is the last of them. A velocity that is no number is not known to be 0.
        """
        config, (low, high) = self.config, self.limits
        at_limit = (share > config.at_limit * high) | (share < config.at_limit * low)
        pushing = at_limit.mean(-1) >= config.pushing_share
        with np.errstate(invalid="ignore"):
            still = np.linalg.norm(velocity[:, :3], axis=-1) < config.still_speed
        self.stalled_s = np.where(pushing & still, self.stalled_s + self.control_dt, 0.0)
        turn = self.control_dt * np.nan_to_num(velocity[:, -1])
        self.turned = np.where(pushing, self.turned + turn, 0.0)
        return (self.stalled_s > config.stalled_s) | (np.abs(self.turned) > 2 * math.pi * config.circles)


class GainWatch(Memory):
    """Cumulative sums (Page 1954) of log likelihood ratios, one per hypothesis, for N vehicles.

    Under a hypothesis, the gains of one or two thrusters have differed by known amounts since the sum was last 0.
    What that does to the innovations follows from the commands and is worked out beside the filter; where these
    thrusters are idle the sum neither grows nor falls. The mean of the likelihood ratios, half of the weight on single
    thrusters, is never above the sum over all moments of change (Shiryaev 1963, Roberts 1966), so that a threshold of
    n for it gives at least n steps between false alarms on average, whatever is commanded (Pollak 1985).

    Args:
        count: number of vehicles N.
        degrees: D, of the motion.
        thrusters: n.
        steps_between_false_alarms: mean number of healthy steps between two alarms, at least.
        config: says which changes are looked for.
    """

    shift: Array  # (N, 2 D, h) of the motion, under each hypothesis
    total: Array  # (N, h)

    def __init__(
        self, count: int, degrees: int, thrusters: int, steps_between_false_alarms: float, config: AdaptationConfig
    ):
        super().__init__()
        self.degrees = degrees
        self.doubt = config.watch_doubt
        single, double = (_hypotheses(thrusters, changed, config.watched_change) for changed in (1, 2))
        self.changes = np.concatenate((single, double)).T  # (n, h) of the gains
        weight = np.concatenate([np.full(len(kind), 0.5 / len(kind)) for kind in (single, double)])
        self.log_weight = np.log(weight)
        self.threshold = math.log(steps_between_false_alarms)
        self.cap = config.watch_cap * (self.threshold - self.log_weight)
        self.remember(shift=np.zeros((count, 2 * degrees, len(weight))), total=np.zeros((count, len(weight))))

    def reset(self, rows: Array) -> None:
        """Begin anew with some vehicles."""
        self.shift[rows] = 0.0
        self.total[rows] = 0.0

    def predict(self, step: Step, effectiveness: Array, share: Array) -> None:
        """Carry the effect of each hypothesis over one control step with thrusts (N, n), shares of full thrust."""
        d = self.degrees
        onward = np.zeros((len(share), 2 * d, 2 * d))
        onward[:, :d, :d] = np.eye(d)
        onward[:, :, d:] = step.by_velocity
        self.shift = onward @ self.shift + step.by_wrench @ (effectiveness * share[:, None]) @ self.changes

    def update(self, entries: Array, innovation: Innovation, usable: Array) -> None:
        """Weigh what was measured in ``entries`` of the motion; rows (N,) that are not ``usable`` keep their sums."""
        expected = self.shift[:, entries]  # (N, m, h)
        weighed = np.linalg.solve(innovation.spread, expected)
        along = (weighed * innovation.offset[..., None]).sum(1)
        power = (weighed * expected).sum(1)
        grown = self.total + np.minimum(along - 0.5 * power - self.doubt * np.sqrt(power), self.cap)
        self.total = np.where(usable[:, None], np.maximum(0.0, grown), self.total)
        left = np.where((grown > 0.0)[:, None], self.shift - innovation.gain[:, : 2 * self.degrees] @ expected, 0.0)
        self.shift = np.where(usable[:, None, None], left, self.shift)

    @property
    def statistic(self) -> Array:
        """Logarithm of the mean likelihood ratio of each vehicle as a share of its threshold, (N,)."""
        return np.logaddexp.reduce(self.total + self.log_weight, axis=1) / self.threshold


def _hypotheses(thrusters: int, changed: int, change: float) -> Array:
    """Changes of the gains (h, n) under which as many thrusters as ``changed`` have each ``change`` more or less."""
    return np.array(
        [
            np.bincount(which, weights=changes, minlength=thrusters)
            for which in itertools.combinations(range(thrusters), changed)
            for changes in itertools.product((-change, change), repeat=changed)
        ]
    )
