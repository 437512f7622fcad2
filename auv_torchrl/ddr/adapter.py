"""The adapter between a policy and a vehicle that behaves differently: a TorchRL transform."""

from typing import Any, cast

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.data import Bounded, Composite, TensorSpec
from torchrl.envs.transforms import Transform

from auv_torchrl.ddr.actuation import Channels, Thrusters
from auv_torchrl.ddr.affine import AffineMap
from auv_torchrl.ddr.config import AdapterConfig
from auv_torchrl.ddr.learner import MapLearner
from auv_torchrl.ddr.models import SourceModels
from auv_torchrl.ddr.network import NetworkMap
from auv_torchrl.vehicle import CONTROLLED

ACTION, APPLIED, OBSERVATION = "action", "applied_action", "observation"


class DDRAdapter(Transform):
    """u_t = H(x, u_s(x)), or H(x, R(x, F(x, u_s(x)))): what the target executes for the source policy's action.

    The rollout keeps the policy's action (N, 4) under ``action`` and reports what was executed, (N, k), under
    ``("next", "applied_action")``. While :attr:`learning`, every true transition updates the map and a dither is
    added as long as the map is uncertain. Networks, bags, modes and the dither's generator are in ``state_dict``.

    Executed commands are finite and within the limits whatever the policy or the measurement: an action that is
    not a number becomes no thrust.

    Args:
        models: F and R of the source vehicle.
        config: settings; ``map: thrusters`` needs an environment whose actions are thruster commands.
        maps: 1 for one map that all vehicles share, or N for one map per vehicle.

    Raises:
        ValueError: for a network map per vehicle.
    """

    def __init__(self, models: SourceModels, config: AdapterConfig | None = None, maps: int = 1):
        super().__init__(in_keys=[], out_keys=[APPLIED], in_keys_inv=[ACTION], out_keys_inv=[ACTION])
        self.config = config or AdapterConfig()
        self.models = models
        self.learner = MapLearner(make_map(models, self.config, maps), len(models.state_names), self.config)
        self.generator = torch.Generator().manual_seed(self.config.seed)
        self.register_buffer("_learning", torch.zeros((), dtype=torch.bool))
        self.learning = False

    # learning

    @property
    def learning(self) -> bool:
        """Whether transitions change the map."""
        return self._learns

    @learning.setter
    def learning(self, value: bool) -> None:
        self._learns = bool(value)
        cast(Tensor, self._learning).fill_(self._learns)

    @property
    def g(self) -> AffineMap:
        """G, whose :meth:`AffineMap.invert` is H."""
        return self.learner.g

    def get_extra_state(self) -> Tensor:
        """State of the dither's generator."""
        return self.generator.get_state()

    def set_extra_state(self, state: Tensor) -> None:
        """Take up the dither where it was; called by ``load_state_dict``."""
        self.generator.set_state(state.cpu())
        self._learns = bool(self._learning)

    # u_s -> u_t

    @torch.no_grad()
    def translate(self, observation: Tensor, action: Tensor) -> Tensor:
        """Commands (N, k) in [-1, 1] for the source policy's actions (N, 4) at observations (N, d)."""
        state = self.models.state_of(observation)
        tau = torch.nan_to_num(action, nan=0.0).clamp(-1.0, 1.0)
        if self.config.composition == "long":
            tau = self.models.R(state, self.models.F(state, tau))
        else:
            tau = self.models.actuation.intended(tau)
        control = self.g.invert(state, tau)
        if self._learns and self.config.dither > 0 and bool(self.learner.uncertain.any()):
            sign = torch.randint(0, 2, control.shape, generator=self.generator).to(control) * 2 - 1
            dithered = control + self.config.dither * sign
            control = self.g.inverse.shrink(torch.where(self.learner.uncertain[:, None], dithered, control))
        command = self.g.space.decode(control)
        sane = (action.isfinite().all(-1) & command.isfinite().all(-1))[:, None]
        return torch.where(sane, command, 0.0)

    # TorchRL

    def _inv_call(self, tensordict: TensorDictBase) -> TensorDictBase:
        command = self.translate(tensordict.get(OBSERVATION), tensordict.get(ACTION))
        return tensordict.set(ACTION, command)

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        command = tensordict.get(ACTION)  # what _inv_call made of it
        if self._learns:
            valid = ~next_tensordict.get("terminated")[..., 0]
            stepped = tensordict.get("_step", None)
            if stepped is not None:
                valid = valid & stepped.reshape(valid.shape)
            before, after = (self.models.state_of(td.get(OBSERVATION)) for td in (tensordict, next_tensordict))
            with torch.no_grad():
                source = self.models.R(before, after)
            self.learner.observe(before, command, source, valid)
        return next_tensordict.set(APPLIED, command)

    def _reset(self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase) -> TensorDictBase:
        observation = tensordict_reset.get(OBSERVATION)
        silent = observation.new_zeros((*observation.shape[:-1], self.g.space.size))
        return tensordict_reset.set(APPLIED, silent)

    def transform_action_spec(self, action_spec: TensorSpec) -> TensorSpec:
        """The policy acts in the four channels, whatever the vehicle takes."""
        executed = cast(Composite, action_spec)[ACTION]
        if executed.shape[-1] != self.g.space.size:
            raise ValueError(
                f"adapter: map={self.config.map} gives {self.g.space.size} commands, the environment takes "
                f"{executed.shape[-1]}: map=thrusters needs a task with thruster_commands=True, the others without"
            )
        cast(Composite, action_spec)[ACTION] = _commands(executed, len(CONTROLLED))
        return action_spec

    def transform_observation_spec(self, observation_spec: TensorSpec) -> TensorSpec:
        """Declare ``applied_action``."""
        observation = cast(Composite, observation_spec)[OBSERVATION]
        cast(Composite, observation_spec)[APPLIED] = _commands(observation, self.g.space.size)
        return observation_spec

    def forward(self, tensordict: TensorDictBase) -> Any:
        """Refuse to act on a replay buffer, where actions are already those of the policy."""
        raise RuntimeError("DDRAdapter belongs between a policy and an environment: append it to the environment")


def make_map(models: SourceModels, config: AdapterConfig, maps: int) -> AffineMap:
    """G and H as the settings say, starting as the healthy vehicle's."""
    if config.map == "network":
        if maps != 1:
            raise ValueError(f"adapter: map=network takes one map, not {maps}: use map=affine for a map per vehicle")
        return NetworkMap(
            Channels(models.actuation), config.ridge, len(models.state_names), config.hidden, config.network_steps,
            config.seed,
        )  # fmt: skip
    space = Thrusters(models.actuation) if config.map == "thrusters" else Channels(models.actuation)
    return AffineMap(maps, space, config.ridge)


def _commands(like: TensorSpec, size: int) -> Bounded:
    shape = torch.Size((*like.shape[:-1], size))
    return Bounded(-1.0, 1.0, shape, dtype=torch.float32, device=like.device)
