"""Allocations to compare with: told the true effectiveness, or learning it by recursive least squares."""

import numpy as np
from tensordict import TensorDictBase

from auv_torchrl.adaptation.config import load_adaptation_config
from auv_torchrl.adaptation.motion import SourceMotion
from auv_torchrl.adaptation.sensing import Sensing
from auv_torchrl.adaptation.transform import Array, ThrusterTransform, array, measured_state
from auv_torchrl.authority import controlled_allocation
from auv_torchrl.ddr.allocation import Allocation
from auv_torchrl.tasks import Task
from auv_torchrl.vehicle import CONTROLLED, Vehicle

_D = len(CONTROLLED)
_START = 10.0  # covariance at the start, in squared shares of full thrust
_LARGEST = 1e4  # at which forgetting stops: a vehicle at rest tells nothing, and the covariance would wind up


class RecursiveLeastSquares(ThrusterTransform):
    """Learns the wrench per thrust at every step, always at the same pace, without a detector and without dither.

    Args:
        vehicle: one vehicle (empty batch), the source.
        task: of the environment.
        count: number of vehicles N.
        memory_s: s, time constant of the forgetting.
    """

    def __init__(self, vehicle: Vehicle, task: Task, count: int, memory_s: float = 1.0):
        super().__init__(vehicle)
        self.motion = SourceMotion(vehicle, task.control_dt)
        self.sensing = Sensing(load_adaptation_config(), count)
        limits = map(array, self.actuation.share_limits)
        self.allocation = Allocation(1.0 / np.square(self.motion.full_wrench), *limits)
        self.forgetting = float(np.exp(-task.control_dt / memory_s))
        n = vehicle.thrusters
        self.effectiveness = np.broadcast_to(self.motion.per_share, (count, _D, n)).copy()
        self.covariance = np.broadcast_to(_START * np.eye(n), (count, n, n)).copy()

    def thrusts(self, nominal: Array) -> Array:
        """Thrusts (N, n) whose wrench, by the present estimate, is that of ``nominal`` (N, n) on the source."""
        return self.allocation(nominal @ self.motion.per_share.T, self.effectiveness, reference=nominal)

    def learn(self, share: Array, before: TensorDictBase, after: TensorDictBase) -> None:
        """One update per vehicle with the wrench that explains the step; steps that are not numbers are left out."""
        velocity, reached = (self.sensing.read(measured_state(td)).raw[:, :_D] for td in (before, after))
        sane = np.isfinite(velocity).all(-1) & np.isfinite(reached).all(-1)
        velocity, reached = np.where(sane[:, None], velocity, 0.0), np.where(sane[:, None], reached, 0.0)
        expected = (self.effectiveness @ share[..., None])[..., 0]
        step = self.motion(velocity, expected)
        missing = np.linalg.solve(step.by_wrench[:, _D:], (reached - step.velocity)[..., None])[..., 0]
        towards = (self.covariance @ share[..., None])[..., 0]
        gain = towards / (self.forgetting + (share * towards).sum(-1, keepdims=True)) * sane[:, None]
        self.effectiveness += missing[..., None] * gain[:, None, :]
        shrunk = self.covariance - gain[..., None] * towards[:, None, :]
        grown = shrunk / self.forgetting
        wound_up = np.trace(grown, axis1=1, axis2=2) > _LARGEST
        self.covariance = np.where(wound_up[:, None, None], shrunk, grown)


class TrueMap(ThrusterTransform):
    """Allocation with the true effectiveness of the target; it knows nothing of delay, current or load.

    Args:
        source: one vehicle (empty batch).
        target: one vehicle (empty batch), e.g. ``scenario.vehicle_at(source)``.
    """

    def __init__(self, source: Vehicle, target: Vehicle):
        super().__init__(source)
        self._nominal = controlled_allocation(source)
        self._true = controlled_allocation(target)[None]
        limits = map(array, self.actuation.share_limits)
        self._allocation = Allocation(1.0 / np.square(np.abs(self._nominal).sum(-1)), *limits)

    def thrusts(self, nominal: Array) -> Array:
        """Thrusts (N, n) whose wrench on the target is that of ``nominal`` (N, n) on the source."""
        return self._allocation(nominal @ self._nominal.T, self._true, reference=nominal)
