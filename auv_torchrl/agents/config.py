"""Settings of the training; the comments are in ``conf/agent/sac.yaml``."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from auv_torchrl.settings import read_settings

POSITIVE = (
    "learning_rate", "alpha_learning_rate", "batch_size", "alpha_init", "num_envs", "steps_per_batch",
    "updates_per_step", "total_frames", "buffer_size", "stretch_steps", "evaluation_starts",
)  # fmt: skip
REPORTING = ("csv", "tensorboard")  # the settings that do not shape the policy


@dataclass(frozen=True)
class AgentConfig:
    """What ``conf/agent/*.yaml`` sets; there are no defaults elsewhere."""

    loss: str
    hidden: tuple[int, ...]
    learning_rate: float
    learning_rate_end: float
    alpha_learning_rate: float
    gamma: float
    tau: float
    batch_size: int
    target_entropy: float
    alpha_init: float
    average: float
    num_envs: int
    steps_per_batch: int
    updates_per_step: int
    random_frames: int
    total_frames: int
    buffer_size: int
    stretch_steps: int
    evaluation_starts: int
    evaluation_box_m: float | None
    stop_below_m: float | None
    csv: bool
    tensorboard: bool

    def __post_init__(self) -> None:
        """Refuse values with which training cannot run."""
        object.__setattr__(self, "hidden", tuple(self.hidden))
        if self.loss not in ("fused", "stock"):
            raise ValueError(f"agent: loss is {self.loss!r}: give fused or stock")
        if not self.hidden or min(self.hidden) < 1:
            raise ValueError(f"agent: hidden is {list(self.hidden)}: give the units of at least one layer")
        for name in POSITIVE:
            if not getattr(self, name) > 0:
                raise ValueError(f"agent: {name} is {getattr(self, name)!r}: give a number above 0")
        for name in ("gamma", "average"):
            if not 0 <= getattr(self, name) < 1:
                raise ValueError(f"agent: {name} is {getattr(self, name)!r}: give a number in [0, 1)")
        for name in ("tau", "learning_rate_end"):
            if not 0 < getattr(self, name) <= 1:
                raise ValueError(f"agent: {name} is {getattr(self, name)!r}: give a number in (0, 1]")
        if self.stretch_steps % self.steps_per_batch:
            raise ValueError(
                f"agent: stretch_steps is {self.stretch_steps}: give a multiple of steps_per_batch, "
                f"{self.steps_per_batch}"
            )

    @property
    def stretch_frames(self) -> int:
        """Transitions between two evaluations."""
        return self.stretch_steps * self.num_envs

    @property
    def stretches(self) -> int:
        """Number of stretches of the whole training."""
        return -(-self.total_frames // self.stretch_frames)


def load_agent_config(name: str = "sac", overrides: Mapping[str, Any] | None = None) -> AgentConfig:
    """Read ``conf/agent/<name>.yaml`` and replace some of its values.

    Raises:
        FileNotFoundError: for an unknown name.
        ValueError: for an unknown, missing or impossible setting.
    """
    return read_settings(AgentConfig, "agent", name, overrides)
