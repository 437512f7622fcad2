"""Settings of the adaptation in one flight; ``conf/online/*.yaml`` gives and explains the values."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from auv_torchrl.settings import read_settings

SENSED = ("velocity", "pose")


@dataclass(frozen=True)
class OnlineConfig:
    """Noise, prior and decisions of the adaptation in one flight; there are no defaults elsewhere.

    Raises:
        ValueError: for a value that cannot work, saying what can.
    """

    sensed: str
    velocity_noise: float
    position_noise: float
    heading_noise: float
    wrench_noise: float
    gain_spread: float
    mixing_spread: float
    constant_spread: float
    gain_drift: float
    constant_drift: float
    drift_spread: float
    false_alarms_per_hour: float
    smallest_shift: float
    dither: float
    uncertain_above: float
    settled_below: float
    longest_search_s: float
    lost_after_s: float
    largest_jump_m: float
    heading_weight: float
    seed: int

    def __post_init__(self) -> None:
        """Refuse values that cannot work."""
        if self.sensed not in SENSED:
            raise ValueError(f"online: sensed is {self.sensed!r}: there are {', '.join(SENSED)}")
        for name in ("velocity_noise", "position_noise", "heading_noise", "wrench_noise", "gain_spread",
                     "mixing_spread", "constant_spread", "drift_spread", "false_alarms_per_hour", "smallest_shift",
                     "uncertain_above", "settled_below", "longest_search_s", "lost_after_s", "largest_jump_m",
                     "heading_weight"):  # fmt: skip
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(f"online: {name} is {getattr(self, name)!r}: give a number above 0")
        for name in ("gain_drift", "constant_drift", "dither"):
            if not 0 <= getattr(self, name) < 1:
                raise ValueError(f"online: {name} is {getattr(self, name)!r}: give a number from 0 to below 1")
        if self.settled_below > self.uncertain_above:
            raise ValueError(
                f"online: settled_below {self.settled_below} is above uncertain_above {self.uncertain_above}: "
                "the dither would never stop"
            )


def load_online_config(name: str = "default", overrides: Mapping[str, Any] | None = None) -> OnlineConfig:
    """Read ``conf/online/<name>.yaml`` and replace some of its values.

    Raises:
        FileNotFoundError: for an unknown name.
        ValueError: for an unknown, missing or impossible setting.
    """
    return read_settings(OnlineConfig, "online", name, overrides)
