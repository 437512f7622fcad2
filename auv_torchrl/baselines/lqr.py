"""Linear-quadratic regulators: of the source vehicle, and of a vehicle whose thrusters are estimated in flight.

Fossen, *Handbook of Marine Craft Hydrodynamics and Motion Control*, 2nd edition 2021, section 16.1 (LQ design for
dynamic positioning). The weights follow Bryson's rule: one over the square of what is tolerated. The adaptive one takes
its estimate for the truth, which Mania, Tu and Recht 2019 (*Certainty Equivalence is Efficient for Linear Quadratic
Control*, NeurIPS) show to be nearly optimal once the estimate is close.
"""

from typing import Any

import numpy as np
import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor

from auv_torchrl.adaptation.motion import SourceMotion
from auv_torchrl.adaptation.transform import Array, array
from auv_torchrl.agents.pid import deviation
from auv_torchrl.baselines.allocations import RecursiveLeastSquares
from auv_torchrl.envs.start import ALONG, BODY, MEASURED
from auv_torchrl.tasks import Task
from auv_torchrl.vehicle import CONTROLLED, CONTROLLED_INDEX, Vehicle

_D = len(CONTROLLED)
TOLERATED = (0.05, 0.05, 0.05, 0.2)  # m and rad away, for which a full command is given
TOLERATED_SPEED = (0.5, 0.5, 0.5, 1.0)  # m/s and rad/s
RENEWED_EVERY = 5  # control steps between two gains of an adaptive regulator
DOUBLINGS = 20  # of the horizon, which is then 2^20 control steps
FORGOTTEN = 1e-9  # of the first state, at which the horizon is long enough
LARGEST = 1e12  # of a value function; beyond it the vehicle cannot be held


def gain_of(motion: SourceMotion, by_command: Array) -> Array:
    """K (..., k, 8): commands are K times (error, -speed) of the source vehicle about rest; NaN where none holds it.

    The Riccati equation is solved for all vehicles at once by the structure-preserving doubling algorithm (Chu, Fan,
    Lin and Wang 2004, *Structure-preserving algorithms for periodic discrete-time algebraic Riccati equations*, section
    2), in one batch where scipy takes a millisecond for each; a test compares the two.

    Args:
        motion: the source vehicle, whose drag about rest is linear.
        by_command: (..., 4, k) wrench per command.
    """
    still = np.zeros((1, _D))
    step = motion(still, still)
    onward = np.eye(2 * _D)
    onward[:, _D:] = step.by_velocity[0]
    onward[:_D, :_D] = np.eye(_D)
    by = step.by_wrench[0] @ by_command
    unit = np.eye(2 * _D)
    a, g, h = onward, by @ by.mT, np.diag(1.0 / np.square((*TOLERATED, *TOLERATED_SPEED)))
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(DOUBLINGS):
            inverse = np.linalg.inv(unit + g @ h)
            a, g, h = a @ inverse @ a, g + a @ inverse @ g @ a.mT, h + a.mT @ h @ inverse @ a
            h = np.where(np.abs(h).max(axis=(-1, -2), keepdims=True) < LARGEST, h, np.nan)
            if not np.nanmax(np.abs(a), initial=0.0) > FORGOTTEN:
                break
        price = np.eye(by.shape[-1]) + by.mT @ h @ by
        gain = np.linalg.solve(price, by.mT @ h @ onward)
    return np.where(np.abs(a).max(axis=(-1, -2), keepdims=True) < FORGOTTEN, gain, np.nan)


class LQR(TensorDictModuleBase):
    """Regulator of the four channels, a state to action (..., 4) within [-1, 1].

    Args:
        vehicle: one vehicle (empty batch), the source.
        task: says where vehicles should be.
    """

    gain: Tensor

    def __init__(self, vehicle: Vehicle, task: Task):
        super().__init__()
        self.task = task
        keys: list[Any] = [*((MEASURED, key) for key in BODY), ALONG]
        self.in_keys, self.out_keys = keys, ["action"]
        motion = SourceMotion(vehicle, task.control_dt)
        mixer = np.asarray(vehicle.mixer)[:, list(CONTROLLED_INDEX)]
        self.register_buffer("gain", torch.from_numpy(gain_of(motion, motion.per_share @ mixer)).float())

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write ``action``."""
        position, quaternion, velocity, along = (tensordict.get(key) for key in self.in_keys)
        error, speed = deviation(self.task, position, quaternion, velocity, along[..., 0])
        state = torch.cat((error, -speed), dim=-1).float()
        return tensordict.set("action", (state @ self.gain.mT).clamp(-1.0, 1.0))


class AdaptiveLQR(RecursiveLeastSquares):
    """Regulator of the thrusters, whose gain follows the wrench per thrust as recursive least squares estimate it.

    Whatever a policy says is left aside. Where the estimate says that no gain holds the vehicle, the last one stays.
    Arguments are those of :class:`RecursiveLeastSquares`.
    """

    def __init__(self, vehicle: Vehicle, task: Task, count: int, memory_s: float = 1.0):
        super().__init__(vehicle, task, count, memory_s)
        self.task = task
        keys: list[Any] = [*self.out_keys_inv, *((MEASURED, key) for key in BODY), ALONG]
        self.out_keys_inv = keys
        self.gains = np.broadcast_to(gain_of(self.motion, self.motion.per_share), (count, vehicle.thrusters, 8)).copy()
        self.steps = 0

    def command(self, action: Tensor, *measured: Tensor) -> Tensor:
        """Thruster commands (N, n) from the measured position, quaternion and velocity, and how far along they are."""
        position, quaternion, velocity, along = measured
        error, speed = (array(part) for part in deviation(self.task, position, quaternion, velocity, along[:, 0]))
        if self.steps % RENEWED_EVERY == 0:
            self._renew()
        self.steps += 1
        state = np.nan_to_num(np.concatenate((error, -speed), axis=-1))
        share = (self.gains @ state[..., None])[..., 0]
        return torch.from_numpy(self.command_for(share).astype(np.float32)).to(action.device)

    def _renew(self) -> None:
        found = gain_of(self.motion, self.effectiveness)
        self.gains = np.where(np.isfinite(found).all(axis=(-1, -2), keepdims=True), found, self.gains)
