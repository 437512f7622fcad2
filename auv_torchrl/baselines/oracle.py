"""The best that a map to the thrusters can do: it is told the target's effectiveness."""

import numpy as np

from auv_torchrl.adaptation.transform import Array, ThrusterTransform, array
from auv_torchrl.authority import controlled_allocation
from auv_torchrl.ddr.allocation import Allocation
from auv_torchrl.vehicle import Vehicle


class TrueMap(ThrusterTransform):
    """Allocation with the true effectiveness of the target; it knows nothing of delay, current or load.

    Args:
        source: one vehicle (empty batch).
        target: one vehicle (empty batch), e.g. ``scenario.vehicle_at(source)``.
    """

    def __init__(self, source: Vehicle, target: Vehicle):
        super().__init__(source)
        low, high = (array(limit) for limit in self.actuation.share_limits)
        self._nominal = array(controlled_allocation(source))
        self._true = array(controlled_allocation(target))[None]
        self._allocation = Allocation(1.0 / np.square(np.abs(self._nominal).sum(-1)), low, high)

    def thrusts(self, nominal: Array) -> Array:
        """Thrusts (N, n) whose wrench on the target is that of ``nominal`` (N, n) on the source."""
        return self._allocation(nominal @ self._nominal.T, self._true, reference=nominal)
