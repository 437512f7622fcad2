"""The adaptation in one flight as a TorchRL transform between a policy and an environment of thruster commands."""

import logging
from typing import cast

import numpy as np
import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.data import Composite, TensorSpec, Unbounded

from auv_torchrl.authority import Authority, Recovery, authority_of
from auv_torchrl.online.config import OnlineConfig
from auv_torchrl.online.learner import OnlineLearner
from auv_torchrl.online.lookahead import Lookahead
from auv_torchrl.online.motion import SourceMotion
from auv_torchrl.online.sensing import Sensing
from auv_torchrl.online.transform import OBSERVATION, Array, ThrusterTransform, array
from auv_torchrl.tasks import Task
from auv_torchrl.vehicle import CONTROLLED, Vehicle

log = logging.getLogger(__name__)

_RANK_TOLERANCE = 0.03  # least share of the largest singular value that counts; of an uncertain map its standard error
TIME, PHASE, ALARM, STATISTIC, MAP = "time", "phase", "alarm", "statistic", "effectiveness"


class OnlineAdapter(ThrusterTransform):
    """What the target's thrusters must do so that it moves as the source vehicle would under the policy's action.

    Every step reports, beside ``applied_action`` (N, n): ``phase`` (N, 1), an index of
    :data:`auv_torchrl.online.learner.PHASES`; ``alarm`` (N, 1), whether a change was noticed in this step;
    ``statistic`` (N, 1), the detector's sum as a share of its threshold (it rests at 0 during a search);
    ``effectiveness`` (N, 4, n), the estimated wrench in N and N m per share of full thrust. Learning runs on the
    CPU in float64 for each vehicle on its own; what has been learnt stays when an episode ends, a new adapter
    knows only the source vehicle. All of it is in ``state_dict``. Where thrust has been found to come late, the
    ``observation`` is the one expected at the time at which the next command acts; where only the pose is sensed, its
    velocities are estimates.

    Args:
        vehicle: one vehicle (empty batch), the source.
        task: of the environment.
        config: settings.
        count: number of vehicles N.
    """

    def __init__(self, vehicle: Vehicle, task: Task, config: OnlineConfig, count: int):
        super().__init__(vehicle)
        self.config = config
        low, high = (array(limit) for limit in self.actuation.share_limits)
        c = self.actuation.coefficients
        edge = array(c.dead_band / c.full_thrust)
        motion = SourceMotion(vehicle, task.control_dt)
        self.lookahead = Lookahead(task, motion)
        sensing = Sensing(task.observation_names, config, count)
        self.learner = OnlineLearner(motion, (low, high), edge, config, sensing, count)
        self._declared_at = logging.WARNING if count == 1 else logging.DEBUG  # of a fleet one asks `authority`

    def get_extra_state(self) -> dict[str, Tensor]:
        """Everything that has been learnt, with the state of the dither's generator."""
        return self.learner.state()

    def set_extra_state(self, state: dict[str, Tensor]) -> None:
        """Take up the flight where it was; called by ``load_state_dict``."""
        self.learner.load_state(state)

    def thrusts(self, nominal: Array) -> Array:
        """Thrusts (N, n) whose wrench is that of ``nominal`` (N, n) on the source vehicle, plus dither in a search."""
        return self.learner.thrusts(nominal)

    def withheld(self, wanted: Array, given: Array) -> None:
        """Let the learner give later what the dead band withholds."""
        self.learner.withheld(wanted, given)

    def learn(self, share: Array, before: TensorDictBase, after: TensorDictBase) -> None:
        """Learn from the step and report."""
        alarm = self.learner.observe(share, array(after.get(OBSERVATION)), array(after.get(TIME))[:, 0])
        self._report(after, torch.from_numpy(alarm)[:, None])
        for row in self.learner.settled.nonzero()[0].tolist():
            judged = self.authority(row)
            if judged.recovery is Recovery.NONE:
                log.log(self._declared_at, "%s", judged)
        observation = after.get(OBSERVATION)
        learner = self.learner
        seen = learner.sensing.shown(array(observation), learner.velocity)
        time = array(after.get(TIME))[:, 0]
        ahead = self.lookahead(seen, learner.raw, learner.timing, *learner.filter.map_of(learner.belief), time)
        after.set(OBSERVATION, torch.from_numpy(ahead).to(observation))

    def authority(self, row: int) -> Authority:
        """What vehicle ``row`` can still do, by the rank of its estimated effectiveness."""
        effectiveness, _ = self.learner.filter.map_of(self.learner.belief)
        unit = self.learner.motion.full_wrench[:, None]
        estimate = torch.from_numpy(effectiveness[row] / unit)
        tolerance = max(_RANK_TOLERANCE, float(self.learner.uncertainty()[row].max()))
        return authority_of(estimate, self.actuation.mixer.double(), f"vehicle {row}", tolerance)

    def _reset(self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase) -> TensorDictBase:
        tensordict_reset = super()._reset(tensordict, tensordict_reset)
        observation = tensordict_reset.get(OBSERVATION)
        mask = None if tensordict is None else tensordict.get("_reset", None)
        rows = np.arange(len(observation)) if mask is None else mask.reshape(-1).cpu().numpy().nonzero()[0]
        self.learner.begin(rows, array(observation))
        seen = self.learner.sensing.shown(array(observation), self.learner.velocity)
        tensordict_reset.set(OBSERVATION, torch.from_numpy(seen).to(observation))
        return self._report(tensordict_reset, torch.zeros((len(observation), 1), dtype=torch.bool))

    def _report(self, tensordict: TensorDictBase, alarm: Tensor) -> TensorDictBase:
        learner = self.learner
        effectiveness, _ = learner.filter.map_of(learner.belief)
        device = tensordict.device
        tensordict.set(ALARM, alarm.to(device))
        tensordict.set(PHASE, torch.from_numpy(learner.phase.copy())[:, None].to(device))
        tensordict.set(STATISTIC, torch.from_numpy(learner.statistic.astype(np.float32))[:, None].to(device))
        return tensordict.set(MAP, torch.from_numpy(effectiveness.astype(np.float32)).to(device))

    def transform_observation_spec(self, observation_spec: TensorSpec) -> TensorSpec:
        """Declare what every step reports."""
        spec = cast(Composite, super().transform_observation_spec(observation_spec))
        batch, device = spec[OBSERVATION].shape[:-1], spec[OBSERVATION].device
        spec[PHASE] = Unbounded(torch.Size((*batch, 1)), dtype=torch.int64, device=device)
        spec[ALARM] = Unbounded(torch.Size((*batch, 1)), dtype=torch.bool, device=device)
        spec[STATISTIC] = Unbounded(torch.Size((*batch, 1)), dtype=torch.float32, device=device)
        shape = torch.Size((*batch, len(CONTROLLED), self.thrusters))
        spec[MAP] = Unbounded(shape, dtype=torch.float32, device=device)
        return spec
