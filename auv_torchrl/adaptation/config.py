"""Settings of the adaptation in one flight; ``conf/adaptation/*.yaml`` gives and explains the values."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from auv_torchrl.settings import Entries, In, OneOf, Seed, check_fields, read_settings

SETTLED_S = 10.0  # after a change; the error is averaged from then on
SENSED = ("velocity", "pose")
Positive = Annotated[float, In("(0, 1000]")]
Noise = Annotated[float, In("[1, 1e9]")]


@dataclass(frozen=True)
class AdaptationConfig:
    """Noise, prior and decisions of the adaptation in one flight; there are no defaults elsewhere.

    Raises:
        ValueError: for a value that cannot work, saying what can.
    """

    sensed: Annotated[str, OneOf(SENSED)]
    velocity_noise: Positive
    position_noise: Positive
    heading_noise: Positive
    wrench_noise: Positive
    gain_spread: Positive
    mixing_spread: Positive
    constant_spread: Positive
    gain_drift: Annotated[float, In("[0, 1)")]
    constant_drift: Annotated[float, In("[0, 1)")]
    drift_spread: Positive
    false_alarms_per_hour: Positive
    smallest_shift: Positive
    dither: Annotated[float, In("[0, 1)")]
    uncertain_above: Positive
    settled_below: Positive
    longest_search_s: Annotated[float, In("(0, 3600]")]
    lost_after_s: Annotated[float, In("(0, 3600]")]
    largest_jump_m: Positive
    heading_weight: Positive
    aside_weight: Positive
    withheld_kept: Annotated[float, In("[0, 1)")]
    rank_tolerance: Annotated[float, In("[0, 1)")]
    capped_share: Annotated[float, In("(0, 1)")]
    watched_change: Positive
    watch_cap: Annotated[float, In("(0, 1)")]
    watch_doubt: Annotated[float, In("[0, 1)")]
    implausible_constant: Positive
    at_limit: Annotated[float, In("(0, 1]")]
    pushing_share: Annotated[float, In("(0, 1]")]
    still_speed: Positive
    stalled_s: Positive
    circles: Positive
    least_search_s: Annotated[float, In("[0, 3600]")]
    surprising_noise: Noise
    largest_gain: Positive
    unexplained_noise: Noise
    noise_rate: Annotated[float, In("[0, 1]")]
    late_noise: Noise
    largest_noise: Noise
    delays_s: Annotated[tuple[float, ...], In("[0, 2]", "s"), Entries(1, 20)]
    lags_s: Annotated[tuple[float, ...], In("[0, 2]", "s"), Entries(1, 20)]
    timing_steps: Annotated[int, In("[1, 60]")]
    timing_error_left: Annotated[float, In("(0, 1)")]
    late_share: Annotated[float, In("(0, 1)")]
    largest_reach: Positive
    believed_after: Annotated[int, In("[1, 1000]")]
    impossible_speed: Positive
    rough_velocity: Positive
    seed: Seed

    def __post_init__(self) -> None:
        """Refuse values that cannot work."""
        check_fields(self, "adaptation")
        if self.settled_below > self.uncertain_above:
            raise ValueError(
                f"adaptation.settled_below is {self.settled_below}: give adaptation.uncertain_above, "
                f"{self.uncertain_above}, or less: above it the dither would never stop"
            )


def load_adaptation_config(name: str = "default", overrides: Mapping[str, Any] | None = None) -> AdaptationConfig:
    """Read ``conf/adaptation/<name>.yaml`` and replace some of its values.

    Raises:
        FileNotFoundError: for an unknown name.
        ValueError: for an unknown, missing or impossible setting.
    """
    return read_settings(AdaptationConfig, "adaptation", name, overrides)
