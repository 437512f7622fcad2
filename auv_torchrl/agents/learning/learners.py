"""What learns with the settings of an agent."""

from functools import singledispatch

import torch

from auv_torchrl.agents.config import AgentConfig, GradientConfig, OffPolicyConfig, PPOConfig
from auv_torchrl.agents.learning.gradient import GradientLearner
from auv_torchrl.agents.learning.learner import Learner
from auv_torchrl.agents.learning.off_policy import OffPolicyLearner
from auv_torchrl.agents.learning.on_policy import OnPolicyLearner


@singledispatch
def make_learner(config: AgentConfig, observations: int, actions: int, device: torch.device) -> Learner:
    """What learns with these settings: their class says which; another one registers its own learner.

    Raises:
        TypeError: for settings that nothing learns with.
    """
    raise TypeError(f"nothing learns with {type(config).__name__}: register a learner with make_learner.register")


@make_learner.register
def _(config: OffPolicyConfig, observations: int, actions: int, device: torch.device) -> Learner:
    return OffPolicyLearner(observations, actions, config, device)


@make_learner.register
def _(config: PPOConfig, observations: int, actions: int, device: torch.device) -> Learner:
    return OnPolicyLearner(observations, actions, config, device)


@make_learner.register
def _(config: GradientConfig, observations: int, actions: int, device: torch.device) -> Learner:
    return GradientLearner(observations, actions, config, device)
