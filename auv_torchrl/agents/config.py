"""Settings of the training; the comments are in ``conf/agent/sac.yaml``."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from auv_torchrl.settings import Entries, In, OneOf, check_fields, read_settings

REPORTING = ("csv", "tensorboard")  # the settings that do not shape the policy


@dataclass(frozen=True)
class AgentConfig:
    """What ``conf/agent/*.yaml`` sets; there are no defaults elsewhere.

    Upper ends keep what is held in memory below about 10 GB.
    """

    loss: Annotated[str, OneOf(("fused", "stock"))]
    hidden: Annotated[tuple[int, ...], In("[1, 4096]"), Entries(1, 8)]
    learning_rate: Annotated[float, In("(0, inf)")]
    learning_rate_end: Annotated[float, In("(0, 1]")]
    alpha_learning_rate: Annotated[float, In("(0, inf)")]
    gamma: Annotated[float, In("[0, 1)")]
    tau: Annotated[float, In("(0, 1]")]
    batch_size: Annotated[int, In("[1, 100000]")]
    target_entropy: Annotated[float, In("[-1000, 1000]")]
    alpha_init: Annotated[float, In("(0, 1000]")]
    average: Annotated[float, In("[0, 1)")]
    num_envs: Annotated[int, In("[1, 100000]")]
    steps_per_batch: Annotated[int, In("[1, 10000]")]
    updates_per_step: Annotated[int, In("[1, 1000]")]
    random_frames: Annotated[int, In("[0, 1000000000]")]
    total_frames: Annotated[int, In("[1, 1000000000]")]
    buffer_size: Annotated[int, In("[1, 50000000]")]
    stretch_steps: Annotated[int, In("[1, 100000]")]
    evaluation_starts: Annotated[int, In("[1, 10000]")]
    evaluation_box_m: Annotated[float, In("(0, 1000]")] | None
    stop_below_m: Annotated[float, In("(0, 1000]")] | None
    csv: bool
    tensorboard: bool

    def __post_init__(self) -> None:
        """Refuse values with which training cannot run."""
        object.__setattr__(self, "hidden", tuple(self.hidden))
        check_fields(self, "agent")
        if self.stretch_steps % self.steps_per_batch:
            raise ValueError(
                f"agent.stretch_steps is {self.stretch_steps}: give a multiple of steps_per_batch, "
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


@dataclass(frozen=True)
class FineTuning:
    """How long a policy is trained on; ``conf/train.yaml`` explains the values."""

    total_frames: Annotated[int, In("[1, 1000000000]")] = 76800
    critic_frames: Annotated[int, In("[0, 1000000000]")] = 25600
    learning_rate: Annotated[float, In("(0, inf)")] = 1.0e-3

    def __post_init__(self) -> None:
        """Refuse values that cannot work."""
        check_fields(self, "tuning")
