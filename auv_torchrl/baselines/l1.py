"""L1 adaptive augmentation of u_s: what the source vehicle's equations do not explain is opposed as a force.

Hovakimyan and Cao, *L1 Adaptive Control Theory*, SIAM 2010, section 3.3 (piecewise constant adaptation law), in the
form in which Wu et al. 2023 (*L1Quad*, arXiv:2302.07208) put it behind a controller that is there already. All of the
uncertainty is matched: the thrusters reach each of the four axes.
"""

import numpy as np
from tensordict import TensorDictBase
from torch import Tensor

from auv_torchrl.adaptation.config import load_adaptation_config
from auv_torchrl.adaptation.motion import SourceMotion
from auv_torchrl.adaptation.sensing import Sensing
from auv_torchrl.adaptation.transform import Array, ThrusterTransform, array, measured_state
from auv_torchrl.ddr.allocation import Allocation
from auv_torchrl.tasks import Task
from auv_torchrl.vehicle import CONTROLLED, Vehicle

_D = len(CONTROLLED)


class L1Augmentation(ThrusterTransform):
    """Adds to the wrench of u_s the opposite of the wrench that is estimated to be missing.

    A predictor runs beside each vehicle: v^ moves as the source vehicle would from the measured velocity v under the
    commanded wrench and the estimate s, and its error v~ = v^ - v decays by exp(-a dt) in a control step. At each step
    s is chosen so that what is left of the error would be gone after it: s = -(dv/dwrench)^-1 exp(-a dt) v~. A low
    pass keeps the command from following s faster than the thrusters should.

    Args:
        vehicle: one vehicle (empty batch), the source.
        task: of the environment.
        count: number of vehicles N.
        decay: a, 1/s.
        bandwidth: of the low pass, rad/s.
    """

    def __init__(self, vehicle: Vehicle, task: Task, count: int, decay: float = 5.0, bandwidth: float = 5.0):
        super().__init__(vehicle)
        self.motion = SourceMotion(vehicle, task.control_dt)
        self.sensing = Sensing(load_adaptation_config(), count)
        self.allocation = Allocation(1.0 / np.square(self.motion.full_wrench), *map(array, self.actuation.share_limits))
        self.left = float(np.exp(-decay * task.control_dt))
        self.passed = float(1.0 - np.exp(-bandwidth * task.control_dt))
        self.error = np.zeros((count, _D))
        self.missing = np.zeros((count, _D))
        self.opposed = np.zeros((count, _D))

    def begin(self, rows: Tensor, tensordict: TensorDictBase) -> None:
        """Nothing is missing at the beginning of an episode."""
        for known in (self.error, self.missing, self.opposed):
            known[rows.numpy()] = 0.0

    def thrusts(self, nominal: Array) -> Array:
        """Thrusts (N, n) whose wrench is that of ``nominal`` (N, n), less what acts beside the thrusters."""
        wanted = nominal @ self.motion.per_share.T - self.opposed
        per_share = np.broadcast_to(self.motion.per_share, (len(nominal), *self.motion.per_share.shape))
        return self.allocation(wanted, per_share, reference=nominal)

    def learn(self, share: Array, before: TensorDictBase, after: TensorDictBase) -> None:
        """Predictor, adaptation law and low pass; a step whose measurements are not numbers leaves all as it is."""
        velocity, reached = (self.sensing.read(measured_state(td)).raw[:, :_D] for td in (before, after))
        sane = (np.isfinite(velocity).all(-1) & np.isfinite(reached).all(-1))[:, None]
        velocity, reached = np.where(sane, velocity, 0.0), np.where(sane, reached, 0.0)
        step = self.motion(velocity, share @ self.motion.per_share.T + self.missing)
        error = step.velocity + self.left * self.error - reached
        by_wrench = step.by_wrench[:, _D:]
        missing = -np.linalg.solve(by_wrench, self.left * error[..., None])[..., 0]
        most = self.motion.full_wrench  # more no thruster could oppose
        self.error = np.where(sane, error, self.error)
        self.missing = np.where(sane, np.clip(missing, -most, most), self.missing)
        self.opposed = self.opposed + self.passed * (self.missing - self.opposed)
