"""What the settings of every agent have in common, and those with which a policy is trained on."""

from abc import ABC
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from auv_torchrl.settings import Entries, In, check_fields

if TYPE_CHECKING:  # the command line needs the settings alone
    import torch

    from auv_torchrl.envs import FleetEnv
    from auv_torchrl.tasks import Task
    from auv_torchrl.vehicle import Vehicle


@dataclass(frozen=True)
class AgentConfig(ABC):
    """What every ``conf/agent/*.yaml`` sets; there are no defaults elsewhere. A subclass is one way to learn.

    Upper ends keep what is held in memory below about 10 GB.
    """

    name: ClassVar[str]  # by which ``agent=<name>`` chooses it

    hidden: Annotated[tuple[int, ...], In("[1, 4096]"), Entries(1, 8)]
    learning_rate: Annotated[float, In("(0, inf)")]
    learning_rate_end: Annotated[float, In("(0, 1]")]
    average: Annotated[float, In("[0, 1)")]
    num_envs: Annotated[int, In("[1, 100000]")]
    steps_per_batch: Annotated[int, In("[2, 10000]")]  # a collector of torchrl 0.14 that stacks one step dies (SIGFPE)
    total_frames: Annotated[int, In("[1, 1000000000]")]
    stretch_steps: Annotated[int, In("[1, 100000]")]
    evaluation_starts: Annotated[int, In("[1, 10000]")]
    evaluation_box_m: Annotated[float, In("(0, 1000]")] | None
    stop_below_m: Annotated[float, In("(0, 1000]")] | None

    def __post_init__(self) -> None:
        """Refuse values with which training cannot run."""
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

    def learning_rate_factor(self, frames: int) -> float:
        """What learning rates are multiplied by after ``frames`` transitions: falls evenly to ``learning_rate_end``."""
        return 1 + (self.learning_rate_end - 1) * (frames / (self.stretches * self.stretch_frames))

    def shaping(self) -> dict[str, Any]:
        """All settings, which shape the policy, as plain values."""
        return {"name": self.name, **asdict(self)}

    def tuned(self, tuning: "FineTuning", last: Mapping[str, float]) -> "AgentConfig":
        """The settings with which a policy is trained on.

        Args:
            tuning: how long, and how fast.
            last: last point of the learning curve of the policy.
        """
        return replace(self, learning_rate=tuning.learning_rate, total_frames=tuning.total_frames)

    def ranges(self, randomization: Mapping[str, Any]) -> Mapping[str, Any]:
        """What the training vehicles are drawn from, given what they would be."""
        return randomization

    def make_fleet(
        self, backend: str, vehicle: "Vehicle", task: "Task", seed: int, device: "torch.device | str"
    ) -> "FleetEnv":
        """The vehicles to learn on."""
        from auv_torchrl.envs import make_fleet

        return make_fleet(backend, vehicle, task, self.num_envs, seed=seed, device=device)


@dataclass(frozen=True)
class FineTuning:
    """How long a policy is trained on; ``conf/train.yaml`` explains the values."""

    total_frames: Annotated[int, In("[1, 1000000000]")] = 76800
    critic_frames: Annotated[int, In("[0, 1000000000]")] = 25600
    learning_rate: Annotated[float, In("(0, inf)")] = 1.0e-3

    def __post_init__(self) -> None:
        """Refuse values that cannot work."""
        check_fields(self, "tuning")
