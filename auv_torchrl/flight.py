"""What vehicles did: the states, thrusts and commands of flights."""

import math
from typing import cast

import torch
from tensordict import TensorClass
from torch import Tensor

from auv_torchrl.physics.kinematics import conjugate, heading_of, least_turn, quaternion_product


class Flight(TensorClass):
    """What N vehicles did, batch (N, T + 1): the start and the state after each of T control steps."""

    time: Tensor  # () s
    position: Tensor  # (3,) m, NED
    quaternion: Tensor  # (4,) wxyz, body to earth
    velocity: Tensor  # (6,) m/s and rad/s, body
    thrust: Tensor  # (n,) N, what each thruster really gave
    command: Tensor  # (n,) thruster commands after mixer and clip, held over the step that ends here
    action: Tensor  # (a,) what the policy asked for over that step
    applied_action: Tensor  # (k,) what the adapter made of it; the same without one
    reference_position: Tensor  # (3,) m, NED, where the task wanted the vehicle
    reference_quaternion: Tensor  # (4,) likewise
    miss: Tensor  # () m, how far off the task calls the vehicle

    def of_start(self, start: int) -> "Flight":
        """The flight of one start, batch (T + 1)."""
        return cast(Flight, self[start])

    @property
    def position_error(self) -> Tensor:
        """Distance to the reference in m, (N, T + 1); infinite once a state is no number."""
        return (self.position - self.reference_position).norm(dim=-1).nan_to_num(nan=math.inf)

    @property
    def heading_error(self) -> Tensor:
        """Absolute heading error in rad, (N, T + 1); pi once a state is no number."""
        off = heading_of(self.quaternion) - heading_of(self.reference_quaternion)
        return least_turn(off).abs().nan_to_num(nan=math.pi)

    @property
    def attitude_error(self) -> Tensor:
        """Angle in rad by which the vehicle is turned from the reference, about any axis; pi once it is no number."""
        off = quaternion_product(conjugate(self.reference_quaternion), self.quaternion)
        turn = 2 * torch.atan2(off[..., 1:].norm(dim=-1), off[..., 0].abs())
        return turn.nan_to_num(nan=math.pi)

    @property
    def moving(self) -> bool:
        """Whether the reference is anywhere else at any time."""
        return bool((self.reference_position != self.reference_position[..., :1, :]).any())
