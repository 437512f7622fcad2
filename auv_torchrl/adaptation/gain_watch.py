"""Notice that one or two thrusters have changed, also where they work only now and then, as in holding a place."""

import itertools
import math
from typing import Any

import numpy as np

from auv_torchrl.adaptation.config import AdaptationConfig
from auv_torchrl.adaptation.filter import MOTION, Innovation
from auv_torchrl.adaptation.memory import Memory
from auv_torchrl.adaptation.motion import Step
from auv_torchrl.vehicle import CONTROLLED

Array = Any
_D = len(CONTROLLED)


class GainWatch(Memory):
    """Cumulative sums (Page 1954) of log likelihood ratios, one per hypothesis, for N vehicles.

    Under a hypothesis, the gains of one or two thrusters have differed by known amounts since the sum was last 0.
    What that does to the innovations follows from the commands and is worked out beside the filter; where these
    thrusters are idle the sum neither grows nor falls. The mean of the likelihood ratios, half of the weight on single
    thrusters, is never above the sum over all moments of change (Shiryaev 1963, Roberts 1966), so that a threshold of
    n for it gives at least n steps between false alarms on average, whatever is commanded (Pollak 1985).

    Args:
        count: number of vehicles N.
        thrusters: n.
        steps_between_false_alarms: mean number of healthy steps between two alarms, at least.
        config: says which changes are looked for.
    """

    shift: Array  # (N, 8, h) of the motion, under each hypothesis
    total: Array  # (N, h)

    def __init__(self, count: int, thrusters: int, steps_between_false_alarms: float, config: AdaptationConfig):
        super().__init__()
        self.doubt = config.watch_doubt
        single, double = (_hypotheses(thrusters, changed, config.watched_change) for changed in (1, 2))
        self.changes = np.concatenate((single, double)).T  # (n, h) of the gains
        weight = np.concatenate([np.full(len(kind), 0.5 / len(kind)) for kind in (single, double)])
        self.log_weight = np.log(weight)
        self.threshold = math.log(steps_between_false_alarms)
        self.cap = config.watch_cap * (self.threshold - self.log_weight)
        self.remember(shift=np.zeros((count, 2 * _D, len(weight))), total=np.zeros((count, len(weight))))

    def reset(self, rows: Array) -> None:
        """Begin anew with some vehicles."""
        self.shift[rows] = 0.0
        self.total[rows] = 0.0

    def predict(self, step: Step, effectiveness: Array, share: Array) -> None:
        """Carry the effect of each hypothesis over one control step with thrusts (N, n), shares of full thrust."""
        onward = np.zeros((len(share), 2 * _D, 2 * _D))
        onward[:, :_D, :_D] = np.eye(_D)
        onward[:, :, _D:] = step.by_velocity
        self.shift = onward @ self.shift + step.by_wrench @ (effectiveness * share[:, None]) @ self.changes

    def update(self, entries: Array, innovation: Innovation, usable: Array) -> None:
        """Weigh what was measured in ``entries`` of the motion; rows (N,) that are not ``usable`` keep their sums."""
        expected = self.shift[:, entries]  # (N, m, h)
        weighed = np.linalg.solve(innovation.spread, expected)
        along = (weighed * innovation.offset[..., None]).sum(1)
        power = (weighed * expected).sum(1)
        grown = self.total + np.minimum(along - 0.5 * power - self.doubt * np.sqrt(power), self.cap)
        self.total = np.where(usable[:, None], np.maximum(0.0, grown), self.total)
        left = np.where((grown > 0.0)[:, None], self.shift - innovation.gain[:, MOTION] @ expected, 0.0)
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
