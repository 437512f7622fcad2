"""The adaptation in one flight as a TorchRL transform between a policy and an environment of thruster commands."""

from typing import Any, cast

import numpy as np
import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.data import Bounded, Composite, TensorSpec, Unbounded
from torchrl.envs.transforms import Transform

from auv_torchrl.ddr.actuation import Actuation
from auv_torchrl.envs import RegulationTask
from auv_torchrl.online.config import OnlineConfig
from auv_torchrl.online.learner import OnlineLearner
from auv_torchrl.online.motion import SourceMotion
from auv_torchrl.online.sensing import Sensing
from auv_torchrl.vehicle import CONTROLLED, Vehicle

ACTION, APPLIED, OBSERVATION, TIME = "action", "applied_action", "observation", "time"
PHASE, ALARM, MAP = "phase", "alarm", "effectiveness"


class OnlineAdapter(Transform):
    """What the target's thrusters must do so that it moves as the source vehicle would under the policy's action.

    The policy acts in the four channels, the environment takes thruster commands. Every step reports, beside
    ``applied_action`` (N, n): ``phase`` (N, 1), an index of :data:`auv_torchrl.online.learner.PHASES`; ``alarm``
    (N, 1), whether a change was noticed in this step; ``effectiveness`` (N, 4, n), the estimated wrench in N and
    N m per share of full thrust. Commands are finite and within [-1, 1] whatever the policy and the measurement: an
    action that is not a number becomes no thrust. Learning runs on the CPU in float64 for each vehicle on its own;
    what has been learnt stays when an episode ends, a new adapter knows only the source vehicle.

    Args:
        vehicle: one vehicle (empty batch), the source.
        task: of the environment.
        config: settings.
        count: number of vehicles N.
    """

    def __init__(self, vehicle: Vehicle, task: RegulationTask, config: OnlineConfig, count: int):
        super().__init__(in_keys=[], out_keys=[APPLIED], in_keys_inv=[ACTION], out_keys_inv=[ACTION])
        self.config = config
        self.actuation = Actuation(vehicle)
        low, high = (limit.double().numpy() for limit in self.actuation.share_limits)
        c = self.actuation.coefficients
        edge = (c.dead_band / c.full_thrust).double().numpy()
        motion = SourceMotion(vehicle, task.control_dt)
        sensing = Sensing(task.observation_names, config, count)
        self.learner = OnlineLearner(motion, (low, high), edge, config, sensing, count)

    @property
    def thrusters(self) -> int:
        """Number of thrusters n."""
        return self.actuation.thrusters

    def get_extra_state(self) -> dict[str, Tensor]:
        """Everything that has been learnt, with the state of the dither's generator."""
        return self.learner.state()

    def set_extra_state(self, state: dict[str, Tensor]) -> None:
        """Take up the flight where it was; called by ``load_state_dict``."""
        self.learner.load_state(state)

    @torch.no_grad()
    def translate(self, action: Tensor) -> Tensor:
        """Thruster commands (N, n) in [-1, 1] for the source policy's actions (N, 4)."""
        sane = action.isfinite().all(-1, keepdim=True)
        action = torch.where(sane, action, 0.0).clamp(-1.0, 1.0).cpu()
        nominal = self.actuation.delivered((action @ self.actuation.mixer.mT).clamp(-1.0, 1.0))
        wanted = self.learner.thrusts(_array(nominal))
        command = self.actuation.command_for(torch.from_numpy(wanted).float())
        command = torch.where(sane.cpu() & command.isfinite().all(-1, keepdim=True), command, 0.0)
        self.learner.withheld(wanted, _array(self.actuation.delivered(command)))
        return command.to(sane.device)

    def _inv_call(self, tensordict: TensorDictBase) -> TensorDictBase:
        return tensordict.set(ACTION, self.translate(tensordict.get(ACTION)))

    @torch.no_grad()
    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        command = tensordict.get(ACTION)  # what _inv_call made of it
        share = _array(self.actuation.delivered(command.cpu()))
        observation = next_tensordict.get(OBSERVATION)
        alarm = self.learner.observe(share, _array(observation), _array(next_tensordict.get(TIME))[:, 0])
        next_tensordict.set(APPLIED, command)
        return self._report(next_tensordict, torch.from_numpy(alarm)[:, None])

    def _reset(self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase) -> TensorDictBase:
        observation = tensordict_reset.get(OBSERVATION)
        mask = None if tensordict is None else tensordict.get("_reset", None)
        rows = np.arange(len(observation)) if mask is None else mask.reshape(-1).cpu().numpy().nonzero()[0]
        self.learner.begin(rows, _array(observation))
        tensordict_reset.set(APPLIED, observation.new_zeros((*observation.shape[:-1], self.thrusters)))
        return self._report(tensordict_reset, torch.zeros((len(observation), 1), dtype=torch.bool))

    def _report(self, tensordict: TensorDictBase, alarm: Tensor) -> TensorDictBase:
        learner = self.learner
        effectiveness, _ = learner.filter.map_of(learner.belief)
        device = tensordict.device
        tensordict.set(ALARM, alarm.to(device))
        tensordict.set(PHASE, torch.from_numpy(learner.phase.copy())[:, None].to(device))
        return tensordict.set(MAP, torch.from_numpy(effectiveness.astype(np.float32)).to(device))

    def transform_action_spec(self, action_spec: TensorSpec) -> TensorSpec:
        """The policy acts in the four channels, the environment must take thruster commands."""
        executed = cast(Composite, action_spec)[ACTION]
        if executed.shape[-1] != self.thrusters:
            raise ValueError(
                f"online adapter: it gives {self.thrusters} thruster commands, the environment takes "
                f"{executed.shape[-1]}: use a task with thruster_commands=True"
            )
        cast(Composite, action_spec)[ACTION] = _commands(executed, len(CONTROLLED))
        return action_spec

    def transform_observation_spec(self, observation_spec: TensorSpec) -> TensorSpec:
        """Declare what every step reports."""
        spec = cast(Composite, observation_spec)
        like = spec[OBSERVATION]
        batch = like.shape[:-1]
        spec[APPLIED] = _commands(like, self.thrusters)
        spec[PHASE] = Unbounded(torch.Size((*batch, 1)), dtype=torch.int64, device=like.device)
        spec[ALARM] = Unbounded(torch.Size((*batch, 1)), dtype=torch.bool, device=like.device)
        shape = torch.Size((*batch, len(CONTROLLED), self.thrusters))
        spec[MAP] = Unbounded(shape, dtype=torch.float32, device=like.device)
        return observation_spec

    def forward(self, tensordict: TensorDictBase) -> Any:
        """Refuse to act on a replay buffer, where actions are already those of the policy."""
        raise RuntimeError("OnlineAdapter belongs between a policy and an environment: append it to the environment")


def _array(tensor: Tensor) -> Any:
    return tensor.detach().cpu().double().numpy()


def _commands(like: TensorSpec, size: int) -> Bounded:
    shape = torch.Size((*like.shape[:-1], size))
    return Bounded(-1.0, 1.0, shape, dtype=torch.float32, device=like.device)
