"""The classical controller: one PID per controlled degree of freedom, in the body frame, and what it feeds forward."""

import math
from collections.abc import Sequence
from typing import Any

import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor

from auv_torchrl.envs.start import ALONG, BODY, EXPECTED, MEASURED, TIME, expected_along
from auv_torchrl.physics import CONTROL_DT, ActiveTerms, prepare
from auv_torchrl.physics.hydrodynamics import acceleration
from auv_torchrl.physics.kinematics import heading_of, matvec, rotation_matrix, wrap_angle
from auv_torchrl.tasks import Reference, Task
from auv_torchrl.vehicle import CONTROLLED, CONTROLLED_INDEX, Vehicle
from auv_torchrl.vehicle.tensors import tensors

PROPORTIONAL = (10.0, 10.0, 10.0, 1.0)  # 1/m, 1/rad: `paper` leaves its dead band at 0.01 m; 3 is 5 times less precise
DERIVATIVE = (1.0, 1.0, 1.0, 0.1)  # s/m, s/rad
INTEGRAL_LIMIT = 0.3  # of the command; more would overshoot from far starts
_C = list(CONTROLLED_INDEX)


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
        error, speed = (part.float() for part in deviation(self.task, position, quaternion, velocity, along))
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


def deviation(
    task: Task, position: Tensor, quaternion: Tensor, velocity: Tensor, along: Tensor
) -> tuple[Tensor, Tensor]:
    """How far the reference is away, m and rad, and the speed relative to it (..., 4), along the axes of the body."""
    reference = task.reference(along)
    to_body = rotation_matrix(quaternion).mT
    away = matvec(to_body, reference.position - position)
    turn = wrap_angle(heading_of(reference.quaternion) - heading_of(quaternion))
    speed = (velocity - reference.moving(to_body))[..., list(CONTROLLED_INDEX)]
    return torch.cat((away, turn.unsqueeze(-1)), dim=-1), speed


def _gain(name: str, values: Sequence[float]) -> Tensor:
    if len(values) != len(CONTROLLED) or not all(math.isfinite(v) and v >= 0 for v in values):
        raise ValueError(f"PID: {name} is {values!r}: give four gains of 0 or more, for {', '.join(CONTROLLED)}")
    return torch.tensor(values, dtype=torch.float32)


class FeedForward:
    """Channels (N, 4) that move a vehicle along the reference in still water: drag, inertia, weight, thrust curve.

    Args:
        vehicle: one vehicle (empty batch), what the flown one is taken for.
        task: says where vehicles should be.
    """

    def __init__(self, vehicle: Vehicle, task: Task):
        self.task = task
        self.c = prepare(tensors(vehicle))
        self.terms = ActiveTerms.of(self.c)
        reach = (self.c.allocation * self.c.full_thrust) @ self.c.routing
        self._thrusts = torch.linalg.pinv(reach[_C])  # (n, 4) shares of full thrust, per N and N m
        self._channels = torch.linalg.pinv(tensors(vehicle).mixer[:, _C])  # (4, n)

    def __call__(self, along: Tensor) -> Tensor:
        """For vehicles that are ``along`` (N,) s along the task."""
        now, soon = (self.task.reference(along.double() + later) for later in (0.0, self.task.control_dt))
        velocity = self._velocity(now)
        wanted = (self._velocity(soon) - velocity) / self.task.control_dt
        nothing = torch.zeros_like(velocity)
        rotation = rotation_matrix(now.quaternion)
        alone = acceleration(self.c, self.terms, rotation, now.position, velocity, nothing)
        wrench = matvec(self.c.mass_matrix, wanted - alone)
        share = matvec(self._thrusts, wrench[..., _C])
        reverse = torch.where(share < 0, 1.0 - self.c.asymmetry, 1.0)
        command = share.sign() * (share / reverse).abs() ** (1.0 / self.c.exponent)
        return matvec(self._channels, command)

    def _velocity(self, reference: Reference) -> Tensor:
        """(N, 6) of the reference along its own axes."""
        moving = reference.moving(rotation_matrix(reference.quaternion).mT)
        return moving if reference.velocity is not None else torch.zeros(*reference.position.shape[:-1], 6).double()
