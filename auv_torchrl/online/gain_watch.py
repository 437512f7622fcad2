"""Notice that a single thruster has changed, also where it works only now and then: a vehicle that holds its place."""

import math
from typing import Any, ClassVar

import numpy as np

from auv_torchrl.online.filter import MOTION, Innovation
from auv_torchrl.online.motion import Step
from auv_torchrl.vehicle import CONTROLLED

Array = Any
_D = len(CONTROLLED)
_CHANGES = np.array((-0.7, 0.7))  # of a gain, that the test is matched to; it grows under any that is larger than half
_CAP = 0.6  # of the threshold: no single measurement can raise an alarm
_DOUBT = 0.15  # correlation that a wrong noise model may leave between past noise, to which a controller reacts with
# commands, and the innovations; without it small commands would seem to speak for a change


class GainWatch:
    """Cumulative sums (Page 1954) of log likelihood ratios, one per thruster and direction of change, for N vehicles.

    Under a hypothesis, the gain of one thruster differs by a known amount. What that does to the innovations follows
    from the commands and is worked out beside the filter; where the thruster is idle the sum neither grows nor falls.
    With a likelihood ratio, a threshold of log n gives at least n steps between false alarms whatever is commanded
    (Lorden 1971), here of all sums together.

    Args:
        count: number of vehicles N.
        thrusters: n.
        steps_between_false_alarms: mean number of healthy steps between two alarms, at least.
    """

    FIELDS: ClassVar = ("shift", "total")

    def __init__(self, count: int, thrusters: int, steps_between_false_alarms: float):
        self.threshold = math.log(steps_between_false_alarms * thrusters * len(_CHANGES))
        self.shift = np.zeros((count, 2 * _D, thrusters))  # of the motion, per change of a gain by 1
        self.total = np.zeros((count, thrusters, len(_CHANGES)))

    def reset(self, rows: Array) -> None:
        """Begin anew with some vehicles."""
        self.shift[rows] = 0.0
        self.total[rows] = 0.0

    def predict(self, step: Step, effectiveness: Array, share: Array) -> None:
        """Carry the effect of each hypothesis over one control step with thrusts (N, n), shares of full thrust."""
        onward = np.zeros((len(share), 2 * _D, 2 * _D))
        onward[:, :_D, :_D] = np.eye(_D)
        onward[:, :, _D:] = step.by_velocity
        self.shift = onward @ self.shift + step.by_wrench @ (effectiveness * share[:, None])

    def update(self, entries: Array, innovation: Innovation, usable: Array) -> None:
        """Weigh what was measured in ``entries`` of the motion; rows (N,) that are not ``usable`` keep their sums."""
        expected = self.shift[:, entries]  # (N, m, n)
        weighed = np.linalg.solve(innovation.spread, expected)
        along = (weighed * innovation.offset[..., None]).sum(1)[..., None]  # (N, n, 1)
        power = (weighed * expected).sum(1)[..., None]
        ratio = _CHANGES * along - 0.5 * _CHANGES**2 * power - _DOUBT * np.abs(_CHANGES) * np.sqrt(power)
        ratio = np.minimum(ratio, _CAP * self.threshold)
        self.total = np.where(usable[:, None, None], np.maximum(0.0, self.total + ratio), self.total)
        absorbed = innovation.gain[:, MOTION] @ expected
        self.shift = self.shift - np.where(usable[:, None, None], absorbed, 0.0)

    @property
    def statistic(self) -> Array:
        """Largest sum of each vehicle as a share of the threshold, (N,)."""
        return self.total.max((1, 2)) / self.threshold
