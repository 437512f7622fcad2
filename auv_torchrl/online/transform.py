"""Between a policy of four channels and an environment of thruster commands: what every map to the thrusters shares."""

from abc import abstractmethod
from typing import Any, cast

import numpy as np
import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.data import Bounded, Composite, TensorSpec
from torchrl.envs.transforms import Transform

from auv_torchrl.ddr.actuation import Actuation
from auv_torchrl.physics import ActiveTerms, prepare
from auv_torchrl.physics.thrusters import thrust_target
from auv_torchrl.vehicle import CONTROLLED, Vehicle

Array = Any
ACTION, APPLIED, OBSERVATION = "action", "applied_action", "observation"


class ThrusterTransform(Transform):
    """Turns channels (N, 4) into thruster commands (N, n), and reports those as ``applied_action``.

    Commands are finite and within [-1, 1] whatever the policy says: an action that is not a number becomes no
    thrust. A map says which thrusts it wants (:meth:`thrusts`) and may learn from every step (:meth:`learn`).

    Args:
        vehicle: one vehicle (empty batch), the source.
    """

    def __init__(self, vehicle: Vehicle):
        super().__init__(in_keys=[], out_keys=[APPLIED], in_keys_inv=[ACTION], out_keys_inv=[ACTION])
        self.actuation = Actuation(vehicle)
        c = prepare(vehicle.double())
        self._terms, self._coefficients = ActiveTerms.of(c), c.numpy()
        self._mixer = array(self.actuation.mixer)

    @property
    def thrusters(self) -> int:
        """Number of thrusters n."""
        return self.actuation.thrusters

    @abstractmethod
    def thrusts(self, nominal: Array) -> Array:
        """Thrusts (N, n), shares of full thrust, where the source vehicle would get ``nominal`` (N, n); numpy."""

    def withheld(self, wanted: Array, given: Array) -> None:
        """Called with the thrusts (N, n) that were wanted and those that dead band and limits left; does nothing."""

    def learn(self, share: Array, before: TensorDictBase, after: TensorDictBase) -> None:
        """Called after every step with the thrusts (N, n) that were commanded; may write to ``after``; does nothing."""

    def delivered(self, command: Array) -> Array:
        """Thrusts (N, n), shares of full thrust, that commands (N, n) give on the source vehicle; numpy."""
        return thrust_target(self._coefficients, self._terms, command) / self._coefficients.full_thrust

    @torch.no_grad()
    def translate(self, action: Tensor) -> Tensor:
        """Thruster commands (N, n) in [-1, 1] for the source policy's actions (N, 4)."""
        channels = array(action)
        sane = np.isfinite(channels).all(-1, keepdims=True)
        channels = np.clip(np.where(sane, channels, 0.0), -1.0, 1.0)
        wanted = self.thrusts(self.delivered(channels @ self._mixer.T))
        command = array(self.actuation.command_for(torch.from_numpy(wanted.astype(np.float32))))
        command = np.where(sane & np.isfinite(command).all(-1, keepdims=True), command, 0.0)
        self.withheld(wanted, self.delivered(command))
        return torch.from_numpy(command.astype(np.float32)).to(action.device)

    def _inv_call(self, tensordict: TensorDictBase) -> TensorDictBase:
        return tensordict.set(ACTION, self.translate(tensordict.get(ACTION)))

    @torch.no_grad()
    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        command = tensordict.get(ACTION)  # what _inv_call made of it
        self.learn(self.delivered(array(command)), tensordict, next_tensordict)
        return next_tensordict.set(APPLIED, command)

    def _reset(self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase) -> TensorDictBase:
        observation = tensordict_reset.get(OBSERVATION)
        silent = observation.new_zeros((*observation.shape[:-1], self.thrusters))
        return tensordict_reset.set(APPLIED, silent)

    def transform_action_spec(self, action_spec: TensorSpec) -> TensorSpec:
        """The policy acts in the four channels, the environment must take thruster commands."""
        executed = cast(Composite, action_spec)[ACTION]
        if executed.shape[-1] != self.thrusters:
            raise ValueError(
                f"{type(self).__name__}: it gives {self.thrusters} thruster commands, the environment takes "
                f"{executed.shape[-1]}: use a task with thruster_commands=True"
            )
        cast(Composite, action_spec)[ACTION] = commands(executed, len(CONTROLLED))
        return action_spec

    def transform_observation_spec(self, observation_spec: TensorSpec) -> TensorSpec:
        """Declare ``applied_action``."""
        spec = cast(Composite, observation_spec)
        spec[APPLIED] = commands(spec[OBSERVATION], self.thrusters)
        return observation_spec

    def forward(self, tensordict: TensorDictBase) -> Any:
        """Refuse to act on a replay buffer, where actions are already those of the policy."""
        raise RuntimeError(
            f"{type(self).__name__} belongs between a policy and an environment: append it to the environment"
        )


def array(tensor: Tensor) -> Array:
    """The tensor as a float64 numpy array."""
    return tensor.detach().cpu().double().numpy()


def commands(like: TensorSpec, size: int) -> Bounded:
    """Spec of ``size`` commands with the batch of another entry."""
    shape = torch.Size((*like.shape[:-1], size))
    return Bounded(-1.0, 1.0, shape, dtype=torch.float32, device=like.device)
