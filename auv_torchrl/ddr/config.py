"""Every setting of the adapter; ``conf/adapter/*.yaml`` gives and explains the values."""

import math
from dataclasses import dataclass

MAPS = ("affine", "network", "thrusters")
COMPOSITIONS = ("short", "long")


@dataclass(frozen=True)
class AdapterConfig:
    """How G and H are represented and learnt.

    Raises:
        ValueError: for a value that cannot work, saying what can.
    """

    map: str = "affine"
    composition: str = "short"  # H(x, u_s) or H(x, R(x, F(x, u_s)))
    target_data_s: float = 4.0
    dither: float = 0.2
    bag_cap: int = 400
    bag_least: int = 12
    least_pairs: int = 12
    ridge: float = 1e-3
    tolerance: float = 0.005
    threshold: float = 0.15
    window: int = 4
    gradient_rate: float = 0.1
    hidden: int = 16
    network_steps: int = 60
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse values that cannot work."""
        for name, choices in (("map", MAPS), ("composition", COMPOSITIONS)):
            if getattr(self, name) not in choices:
                raise ValueError(f"adapter: {name} is {getattr(self, name)!r}: there are {', '.join(choices)}")
        for name in ("target_data_s", "ridge", "tolerance", "threshold"):
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(f"adapter: {name} is {getattr(self, name)!r}: give a number above 0")
        for name in ("dither", "gradient_rate"):
            if not 0 <= getattr(self, name) < 1:
                raise ValueError(f"adapter: {name} is {getattr(self, name)!r}: give a number from 0 to below 1")
        for name in ("bag_cap", "bag_least", "least_pairs", "window", "hidden", "network_steps"):
            if getattr(self, name) < 1:
                raise ValueError(f"adapter: {name} is {getattr(self, name)!r}: give a whole number of 1 or more")
        if self.bag_cap < self.least_pairs:
            raise ValueError(
                f"adapter: bag_cap {self.bag_cap} is below least_pairs {self.least_pairs}: a fit would never start"
            )
