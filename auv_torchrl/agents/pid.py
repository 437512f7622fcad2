"""The classical controller: one PID per controlled degree of freedom, in the body frame."""

import math
from collections.abc import Sequence
from typing import Any

import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor

from auv_torchrl.agents.feed_forward import FeedForward
from auv_torchrl.envs.expected import EXPECTED, MEASURED, TIME, expected_along
from auv_torchrl.envs.start import ALONG, BODY
from auv_torchrl.physics import CONTROL_DT
from auv_torchrl.physics.kinematics import euler_angles, matvec, rotation_matrix, wrap_angle
from auv_torchrl.tasks import Task
from auv_torchrl.vehicle import CONTROLLED, CONTROLLED_INDEX, Vehicle

PROPORTIONAL = (10.0, 10.0, 10.0, 1.0)  # 1/m, 1/rad: `paper` leaves its dead band at 0.01 m; 3 is 5 times less precise
DERIVATIVE = (1.0, 1.0, 1.0, 0.1)  # s/m, s/rad
INTEGRAL_LIMIT = 0.3  # of the command; more would overshoot from far starts


class PID(TensorDictModuleBase):
    """A state to action (..., 4) = P error - D speed + integral + feed-forward, clipped to [-1, 1].

    Error and speed are those to the task's reference, along the axes of the body. The channels have the mixer's unit,
    full command. With an integral gain the module keeps a sum per vehicle, which grows only while the command is not
    saturated and starts anew with each episode: it then needs a fixed batch.

    Args:
        task: says where vehicles should be.
        proportional: gain per controlled degree of freedom, 1/m and 1/rad.
        derivative: gain on the body velocity, s/m and s/rad.
        integral: gain on the summed error, 1/(m s) and 1/(rad s); None for none.
        state: where position, quaternion and velocity are: ``measured``, or ``expected`` behind a map that predicts.
        vehicle: one vehicle (empty batch), what the motion of the reference takes of it is fed forward; None for none.

    Raises:
        ValueError: if a gain is not four finite numbers of 0 or more.
    """

    proportional: Tensor
    derivative: Tensor
    integral: Tensor | None

    def __init__(
        self,
        task: Task,
        proportional: Sequence[float] = PROPORTIONAL,
        derivative: Sequence[float] = DERIVATIVE,
        integral: Sequence[float] | None = None,
        state: str = MEASURED,
        vehicle: Vehicle | None = None,
    ):
        super().__init__()
        keys: list[Any] = [*((state, key) for key in BODY), TIME, ALONG]
        self._expects = state == EXPECTED
        if self._expects:
            keys.append((EXPECTED, TIME))
        self.in_keys = keys
        self.out_keys = ["action"]
        self.task = task
        self.register_buffer("proportional", _gain("proportional", proportional))
        self.register_buffer("derivative", _gain("derivative", derivative))
        self.register_buffer("integral", None if integral is None else _gain("integral", integral))
        self._sum: Tensor | None = None
        self._feed_forward = None if vehicle is None else FeedForward(vehicle, task)

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write ``action``."""
        position, quaternion, velocity, time, now = (tensordict[key] for key in self.in_keys[:5])
        along = (expected_along(tensordict) if self._expects else now)[..., 0]
        reference = self.task.reference(along)
        to_body = rotation_matrix(quaternion).mT
        away = matvec(to_body, reference.position - position)
        turn = wrap_angle(euler_angles(reference.quaternion)[2] - euler_angles(quaternion)[2])
        error = torch.cat((away, turn.unsqueeze(-1)), dim=-1).float()
        speed = (velocity - reference.moving(to_body))[..., list(CONTROLLED_INDEX)].float()
        action = self.proportional * error - self.derivative * speed
        if self._feed_forward is not None:
            action = action + self._feed_forward(along).float()
        if self.integral is not None:
            action = action + self._integrate(self.integral * error, action, time)
        return tensordict.set("action", action.clamp(-1.0, 1.0))

    def _integrate(self, rate: Tensor, action: Tensor, time: Tensor) -> Tensor:
        held = self._sum if self._sum is not None and self._sum.shape == rate.shape else torch.zeros_like(rate)
        grown = torch.where(action.abs() < 1.0, held + CONTROL_DT * rate, held)
        begins = time < CONTROL_DT / 2
        self._sum = torch.where(begins, 0.0, grown.clamp(-INTEGRAL_LIMIT, INTEGRAL_LIMIT))
        return self._sum


def _gain(name: str, values: Sequence[float]) -> Tensor:
    if len(values) != len(CONTROLLED) or not all(math.isfinite(v) and v >= 0 for v in values):
        raise ValueError(f"PID: {name} is {values!r}: give four gains of 0 or more, for {', '.join(CONTROLLED)}")
    return torch.tensor(values, dtype=torch.float32)
