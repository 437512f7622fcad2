"""Settings of the training, one class for each agent; the comments are in ``conf/agent/*.yaml``."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any

from auv_torchrl.agents.agent_config import AgentConfig, FineTuning
from auv_torchrl.paths import config_path
from auv_torchrl.registry import Registry
from auv_torchrl.settings import In, OneOf, choices, settings_of
from auv_torchrl.yaml_file import read_yaml

if TYPE_CHECKING:  # the command line needs the settings alone
    import torch
    from torchrl.objectives import SACLoss

    from auv_torchrl.agents.learning.updater import Updater
    from auv_torchrl.envs import FleetEnv
    from auv_torchrl.tasks import Task
    from auv_torchrl.vehicle import Vehicle

__all__ = [
    "AGENTS", "AgentConfig", "FineTuning", "GradientConfig", "OffPolicyConfig", "PPOConfig", "SACConfig",
    "TD3Config", "load_agent_config", "read_agent",
]  # fmt: skip


@dataclass(frozen=True)
class OffPolicyConfig(AgentConfig):
    """What agents have in common that learn from a replay buffer."""

    gamma: Annotated[float, In("[0, 1)")]
    tau: Annotated[float, In("(0, 1]")]
    batch_size: Annotated[int, In("[1, 100000]")]
    updates_per_step: Annotated[int, In("[1, 1000]")]
    random_frames: Annotated[int, In("[0, 1000000000]")]
    buffer_size: Annotated[int, In("[1, 50000000]")]

    def tuned(self, tuning: "FineTuning", last: Mapping[str, float]) -> AgentConfig:
        """Without random actions."""
        return replace(super().tuned(tuning, last), random_frames=0)  # pyright: ignore[reportCallIssue]

    @abstractmethod
    def make_updater(self, observations: int, actions: int, device: "torch.device") -> "Updater":
        """Networks, losses, and what steps them."""


@dataclass(frozen=True)
class SACConfig(OffPolicyConfig):
    """Soft actor-critic; ``conf/agent/sac.yaml``."""

    name = "sac"

    loss: Annotated[str, OneOf(("fused", "stock"))]
    critic_distance: Annotated[str, OneOf(("l1", "l2", "smooth_l1"))]
    alpha_learning_rate: Annotated[float, In("(0, inf)")]
    target_entropy: Annotated[float, In("[-1000, 1000]")]
    alpha_init: Annotated[float, In("(0, 1000]")]

    def shaping(self) -> dict[str, Any]:
        """Without the name of SAC itself: so policies kept before there were other agents are found."""
        return {key: value for key, value in super().shaping().items() if (key, value) != ("name", "sac")}

    def tuned(self, tuning: "FineTuning", last: Mapping[str, float]) -> AgentConfig:
        """With the temperature that the policy was left with, too."""
        alpha = max(last.get("alpha", self.alpha_init), 1e-4)
        return replace(super().tuned(tuning, last), alpha_init=alpha)  # pyright: ignore[reportCallIssue]

    def make_loss(
        self, observations: int, actions: int, device: "torch.device", kind: "type[SACLoss] | None" = None
    ) -> "SACLoss":
        """Actor, twin critics and temperature, in a loss module of one's own where ``kind`` is one."""
        from auv_torchrl.agents.learning.losses import make_loss

        return make_loss(
            kind or self.loss, observations, actions, self.hidden, gamma=self.gamma,
            target_entropy=self.target_entropy, alpha_init=self.alpha_init, distance=self.critic_distance,
            device=device,
        )  # fmt: skip

    def make_updater(self, observations: int, actions: int, device: "torch.device") -> "Updater":
        """Of actor, twin critics and temperature."""
        from auv_torchrl.agents.learning.updater import SACUpdater

        loss = self.make_loss(observations, actions, device)
        return SACUpdater(loss, self.learning_rate, self.alpha_learning_rate, self.tau)


@dataclass(frozen=True)
class TD3Config(OffPolicyConfig):
    """Twin delayed policy gradient; ``conf/agent/td3.yaml``."""

    name = "td3"

    exploration: Annotated[float, In("[0.001, 10]")]
    target_noise: Annotated[float, In("[0, 10]")]
    target_noise_limit: Annotated[float, In("[0, 10]")]
    actor_every: Annotated[int, In("[1, 1000]")]

    def make_updater(self, observations: int, actions: int, device: "torch.device") -> "Updater":
        """Of actor and twin critics."""
        from auv_torchrl.agents.learning.losses import make_td3_loss
        from auv_torchrl.agents.learning.updater import TD3Updater

        loss = make_td3_loss(
            observations, actions, self.hidden, gamma=self.gamma, exploration=self.exploration,
            target_noise=self.target_noise, target_noise_limit=self.target_noise_limit, device=device,
        )  # fmt: skip
        return TD3Updater(loss, self.learning_rate, self.tau, self.actor_every)


@dataclass(frozen=True)
class PPOConfig(AgentConfig):
    """Proximal policy optimisation; ``conf/agent/ppo.yaml``."""

    name = "ppo"

    gamma: Annotated[float, In("[0, 1)")]
    trace: Annotated[float, In("[0, 1]")]
    clip: Annotated[float, In("(0, 1]")]
    entropy: Annotated[float, In("[0, 10]")]
    epochs: Annotated[int, In("[1, 1000]")]
    batch_size: Annotated[int, In("[1, 100000]")]
    gradient_norm: Annotated[float, In("(0, inf)")]


@dataclass(frozen=True)
class GradientConfig(AgentConfig):
    """Analytic policy gradient through the simulator; ``conf/agent/gradient.yaml``."""

    name = "gradient"

    gradient_norm: Annotated[float, In("(0, inf)")]
    restart: Annotated[float, In("[0, 1]")]
    delay_s: Annotated[float, In("[0, 1]")]
    current: Annotated[float, In("[0, 1]")]

    def tuned(self, tuning: "FineTuning", last: Mapping[str, float]) -> AgentConfig:
        """Soft actor-critic: what stands between policy and fleet is not differentiable."""
        return load_agent_config("sac", {"hidden": list(self.hidden)}).tuned(tuning, last)

    def ranges(self, randomization: Mapping[str, Any]) -> Mapping[str, Any]:
        """Delays and a current beside what is drawn, but where nothing is or the ranges name them themselves."""
        delay, current = [0.0, self.delay_s], [-self.current, self.current]
        further: dict[str, Any] = {}
        if randomization and self.delay_s:
            further |= {"pose_delay": {"delay": delay}, "command_delay": {"delay": delay}}
        if randomization and self.current:
            further |= {"current": {"north": current, "east": current}}
        return {**randomization, **{name: drawn for name, drawn in further.items() if name not in randomization}}

    def make_fleet(
        self, backend: str, vehicle: "Vehicle", task: "Task", seed: int, device: "torch.device | str"
    ) -> "FleetEnv":
        """Whatever the backend, vehicles on torch, which alone is differentiable; the examiner flies the backend."""
        from auv_torchrl.envs import make_fleet

        return make_fleet("torch", vehicle, task, self.num_envs, seed=seed, device=device, straight_through=True)


AGENTS: Registry[type[AgentConfig]] = Registry("agents", AgentConfig, (SACConfig, TD3Config, PPOConfig, GradientConfig))


def read_agent(settings: Mapping[str, Any]) -> AgentConfig:
    """An agent from ``{name: sac, ...}`` as in ``conf/agent/*.yaml``.

    Raises:
        ValueError: for an unknown name, or an unknown, missing or impossible setting.
    """
    settings = dict(settings)
    name = settings.pop("name", None)
    if name not in AGENTS:
        raise ValueError(f"agent: no agent named {name!r}: {choices([name], AGENTS)}")
    return settings_of(AGENTS[name], settings, "agent")


def load_agent_config(name: str = "sac", overrides: Mapping[str, Any] | None = None) -> AgentConfig:
    """Read ``conf/agent/<name>.yaml`` and replace some of its values.

    Raises:
        FileNotFoundError: for an unknown name.
        ValueError: for an unknown, missing or impossible setting.
    """
    content = read_yaml(config_path("agent", name), "agent")
    content.pop("defaults", None)  # types for Hydra
    return read_agent({**content, **(overrides or {})})
