"""The thrusts whose wrench comes nearest to what is wanted, within limits, with caution where the map is uncertain."""

from typing import Any

import numpy as np

Array = Any
_RIDGE = 1e-4  # keeps thrusts that make no difference at their reference; costs 0.1 % of the wrench
_ROUNDS = 4  # of fixing thrusters at their limits; six thrusters hardly ever need more than two


class Allocation:
    """Minimise the expected squared error of the wrench, each degree of freedom in units of what it can give.

    Args:
        weight: (4,) on the squared error of each degree of freedom.
        low: (n,) smallest thrusts, shares of full thrust.
        high: (n,) largest ones.
    """

    def __init__(self, weight: Array, low: Array, high: Array):
        self.weight, self.low, self.high = weight, low, high

    def __call__(self, wanted: Array, effectiveness: Array, caution: Array, reference: Array) -> Array:
        """Thrusts (N, n), shares of full thrust.

        Args:
            wanted: (N, 4) wrench, less what acts without the thrusters.
            effectiveness: (N, 4, n) wrench per share.
            caution: (N, n, n) weighted covariance of it: uncertain thrusters are used less.
            reference: (N, n) thrusts to stay near where that costs nothing.
        """
        n = effectiveness.shape[-1]
        pulled = effectiveness.swapaxes(1, 2) * self.weight
        hessian = pulled @ effectiveness + caution + _RIDGE * np.eye(n)
        linear = (pulled @ wanted[..., None])[..., 0] + _RIDGE * reference
        share = np.linalg.solve(hessian, linear[..., None])[..., 0]
        fixed = np.zeros(share.shape, dtype=bool)
        for _ in range(_ROUNDS):
            beyond = ~fixed & ((share > self.high) | (share < self.low))
            if not beyond.any():
                return share
            fixed |= beyond
            held = np.where(fixed, np.clip(share, self.low, self.high), 0.0)
            free = ~fixed
            system = hessian * (free[:, :, None] & free[:, None, :]) + fixed[:, :, None] * np.eye(n)
            right = np.where(free, linear - (hessian @ held[..., None])[..., 0], held)
            share = np.linalg.solve(system, right[..., None])[..., 0]
        return np.clip(share, self.low, self.high)
