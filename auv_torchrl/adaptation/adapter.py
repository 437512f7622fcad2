"""The adaptation in one flight as a TorchRL transform between a policy and an environment of thruster commands."""

import logging
from typing import cast

import numpy as np
import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.data import Composite, TensorSpec, Unbounded

from auv_torchrl.adaptation.config import AdaptationConfig
from auv_torchrl.adaptation.learner import InFlightLearner
from auv_torchrl.adaptation.motion import motion_of
from auv_torchrl.adaptation.timing import look_ahead
from auv_torchrl.adaptation.transform import Array, ThrusterTransform, array, measured_state, set_expected
from auv_torchrl.authority import Authority, Recovery, authority_of
from auv_torchrl.ddr.transform import OBSERVATION
from auv_torchrl.envs.start import EXPECTED, TIME, expected_spec
from auv_torchrl.tasks import Task
from auv_torchrl.vehicle import Vehicle

log = logging.getLogger(__name__)

PHASE, ALARM, STATISTIC, MAP = "phase", "alarm", "statistic", "effectiveness"


class InFlightAdapter(ThrusterTransform):
    """What the target's thrusters must do so that it moves as the source vehicle would under the policy's action.

    Every step reports, beside ``applied_action`` (N, n): ``phase`` (N, 1), an index of
    :data:`auv_torchrl.adaptation.learner.PHASES`; ``alarm`` (N, 1), whether a change was noticed in this step;
    ``statistic`` (N, 1), the detector's sum as a share of its threshold (it rests at 0 during a search);
    ``effectiveness`` (N, a, n), the estimated wrench in N and N m along the axes of an action per share of full thrust,
    of fins at the speed of the task; and ``expected``, with
    ``position``, ``quaternion``, ``velocity`` and ``time``: the measured state, with estimated velocities where only
    the pose is sensed, and where thrust has been found to come late that of the time at which the next command acts. A
    policy sees it through :class:`auv_torchrl.ddr.transform.Observe`.

    Learning runs on the CPU in float64 for each vehicle on its own; what has been learnt stays when an episode ends, a
    new adapter knows only the source vehicle. All of it is in ``state_dict``.

    Args:
        vehicle: one vehicle (empty batch), the source.
        task: of the environment.
        config: settings.
        count: number of vehicles N.
    """

    def __init__(self, vehicle: Vehicle, task: Task, config: AdaptationConfig, count: int):
        super().__init__(vehicle, task, reports=(PHASE, ALARM, STATISTIC, MAP, EXPECTED))
        self.config = config
        low, high = (array(limit) for limit in self.actuation.share_limits)
        c = self.actuation.coefficients
        edge = array(c.dead_band / c.full_thrust)
        self.learner = InFlightLearner(motion_of(vehicle, task), (low, high), edge, config, count)
        self._declared_at = logging.WARNING if count == 1 else logging.DEBUG  # of a fleet one asks `authority`

    def thrusts(self, nominal: Array) -> Array:
        """Thrusts (N, n) whose wrench is that of ``nominal`` (N, n) on the source vehicle, plus dither in a search."""
        return self.learner.thrusts(nominal)

    def withheld(self, wanted: Array, command: Array) -> None:
        """Let the learner give later what the dead band withholds."""
        self.learner.withheld(wanted, self.delivered(command))

    def learn(self, share: Array, before: TensorDictBase, after: TensorDictBase) -> None:
        """Learn from the step and report."""
        measured, time = measured_state(after), array(after.get(TIME))[:, 0]
        alarm = self.learner.observe(share, measured, time)
        for row in self.learner.settled.nonzero()[0].tolist():
            verdict = self.authority(row)
            if verdict.recovery is Recovery.NONE:
                log.log(self._declared_at, "%s", verdict)
        estimate = self.learner.estimate
        seen = estimate.sensing.shown(measured, estimate.velocity)
        self._report(after, alarm, *look_ahead(estimate.motion, seen, time, estimate.timing, *estimate.map))

    def begin(self, rows: Tensor, tensordict: TensorDictBase) -> None:
        """Begin the episodes of some vehicles and report."""
        measured, estimate = measured_state(tensordict), self.learner.estimate
        self.learner.begin(rows.numpy(), measured)
        seen = estimate.sensing.shown(measured, estimate.velocity)
        self._report(tensordict, np.zeros(len(measured), dtype=bool), seen, array(tensordict.get(TIME))[:, 0])

    def authority(self, row: int) -> Authority:
        """What vehicle ``row`` can still do, by the rank of its estimated effectiveness."""
        estimate = self.learner.estimate
        rows, unit = estimate.motion.controlled, estimate.motion.full_wrench[:, None]
        effectiveness = torch.from_numpy((estimate.map[0][row] / unit)[rows])
        tolerance = max(self.config.rank_tolerance, float(estimate.uncertainty()[row].max()))
        axes = estimate.motion.axes
        return authority_of(effectiveness, self.actuation.mixer.double(), f"vehicle {row}", tolerance, axes)

    def _report(self, tensordict: TensorDictBase, alarm: Array, state: Array, time: Array) -> None:
        learner = self.learner
        column = {ALARM: alarm, PHASE: learner.phase.copy(), STATISTIC: learner.statistic.astype(np.float32)}
        for name, values in column.items():
            tensordict.set(name, torch.from_numpy(values)[:, None].to(tensordict.device))
        effectiveness = learner.estimate.map[0][:, learner.motion.controlled].astype(np.float32)
        tensordict.set(MAP, torch.from_numpy(effectiveness).to(tensordict.device))
        set_expected(tensordict, state, time)

    def transform_observation_spec(self, observation_spec: TensorSpec) -> TensorSpec:
        """Declare what every step reports."""
        spec = cast(Composite, super().transform_observation_spec(observation_spec))
        batch, device = spec[OBSERVATION].shape[:-1], spec[OBSERVATION].device
        spec[PHASE] = Unbounded(torch.Size((*batch, 1)), dtype=torch.int64, device=device)
        spec[ALARM] = Unbounded(torch.Size((*batch, 1)), dtype=torch.bool, device=device)
        spec[STATISTIC] = Unbounded(torch.Size((*batch, 1)), dtype=torch.float32, device=device)
        shape = torch.Size((*batch, self.channels, self.thrusters))
        spec[MAP] = Unbounded(shape, dtype=torch.float32, device=device)
        spec[EXPECTED] = expected_spec(spec)
        return spec
