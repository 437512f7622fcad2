"""Every setting of the adapter; ``conf/adapter/*.yaml`` gives and explains the values."""

from dataclasses import dataclass
from typing import Annotated

from auv_torchrl.settings import In, OneOf, Seed, check_fields

MAPS = ("affine", "network", "thrusters")
COMPOSITIONS = ("short", "long")


@dataclass(frozen=True)
class AdapterConfig:
    """How G and H are represented and learnt.

    Raises:
        ValueError: for a value that cannot work, saying what can.
    """

    map: Annotated[str, OneOf(MAPS)] = "affine"
    shared: bool = True  # one map for all vehicles of a fleet, or one for each
    composition: Annotated[str, OneOf(COMPOSITIONS)] = "short"  # H(x, u_s) or H(x, R(x, F(x, u_s)))
    target_data_s: Annotated[float, In("(0, 3600]")] = 4.0
    dither: Annotated[float, In("[0, 1)")] = 0.2
    dither_steps: Annotated[int, In("[1, 1000]")] = 1
    bag_cap: Annotated[int, In("[1, 100000]")] = 400
    bag_least: Annotated[int, In("[1, 100000]")] = 12
    least_pairs: Annotated[int, In("[1, 100000]")] = 12
    ridge: Annotated[float, In("(0, 1000]")] = 1e-3
    tolerance: Annotated[float, In("(0, 1000]")] = 0.005
    threshold: Annotated[float, In("(0, 1000]")] = 0.15
    window: Annotated[int, In("[1, 10000]")] = 4
    gradient_rate: Annotated[float, In("[0, 1)")] = 0.1
    hidden: Annotated[int, In("[1, 4096]")] = 16
    network_steps: Annotated[int, In("[1, 100000]")] = 60
    impossible: Annotated[float, In("(0, 1000]")] = 4.0
    seed: Seed = 0

    def __post_init__(self) -> None:
        """Refuse values that cannot work."""
        check_fields(self, "adapter")
        if self.bag_cap < self.least_pairs:
            raise ValueError(
                f"adapter.bag_cap is {self.bag_cap}: give adapter.least_pairs, {self.least_pairs}, or more: below it "
                "a fit would never start"
            )
