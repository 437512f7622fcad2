"""The commands that a moving reference takes by itself: what the classical controller adds to what it corrects."""

import torch
from torch import Tensor

from auv_torchrl.physics import ActiveTerms, prepare
from auv_torchrl.physics.hydrodynamics import acceleration
from auv_torchrl.physics.kinematics import matvec, rotation_matrix
from auv_torchrl.tasks import Reference, Task
from auv_torchrl.vehicle import CONTROLLED_INDEX, Vehicle

_C = list(CONTROLLED_INDEX)


class FeedForward:
    """Channels (N, 4) that move a vehicle along the reference in still water: drag, inertia, weight, thrust curve.

    Args:
        vehicle: one vehicle (empty batch), what the flown one is taken for.
        task: says where vehicles should be.
    """

    def __init__(self, vehicle: Vehicle, task: Task):
        self.task = task
        self.c = prepare(vehicle.double())
        self.terms = ActiveTerms.of(self.c)
        reach = (self.c.allocation * self.c.full_thrust) @ self.c.routing
        self._thrusts = torch.linalg.pinv(reach[_C])  # (n, 4) shares of full thrust, per N and N m
        self._channels = torch.linalg.pinv(vehicle.mixer[:, _C].double())  # (4, n)

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
