"""Settings of the flights of a target vehicle that are diagnosed."""

from dataclasses import dataclass
from typing import Annotated

from auv_torchrl.settings import In, Seed, check_fields


@dataclass(frozen=True)
class Excitation:
    """How long the target is flown for a diagnosis; ``conf/train.yaml`` explains the values."""

    episodes: Annotated[int, In("[1, 1000]")] = 6
    episode_s: Annotated[float, In("[5, 3600]", "s")] = 30.0
    seed: Seed = 0

    def __post_init__(self) -> None:
        """Refuse flights that show nothing."""
        check_fields(self, "excitation")

    @property
    def seconds(self) -> float:
        """Flown in all."""
        return self.episodes * self.episode_s
