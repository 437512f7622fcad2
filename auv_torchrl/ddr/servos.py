"""Where the servos of the source vehicle stand, as far as they have followed commands; a saved flight goes on there."""

import torch
from torch import Tensor, nn

from auv_torchrl.ddr.actuation import Actuation


class Servos(nn.Module):
    """Follows the shares that vehicles are given, one row each; where servos stand is in ``state_dict``.

    Args:
        actuation: of the source vehicle.
        control_dt: s, for which a share is given.
    """

    def __init__(self, actuation: Actuation, control_dt: float):
        super().__init__()
        self.thrusters, self.control_dt = actuation.thrusters, control_dt
        self._turning = actuation.turning
        self.stands = torch.zeros(0, actuation.thrusters)  # (N, n) shares

    def begin(self, rows: Tensor, count: int) -> None:
        """Servos of the vehicles in some rows (r,), of so many, stand in their middle."""
        if len(self.stands) != count:
            self.stands = torch.zeros(count, self.thrusters)
        self.stands[rows] = 0.0

    def follow(self, share: Tensor) -> Tensor:
        """Mean shares (N, n) over a control step in which shares (N, n) are given."""
        before = self.stands.to(share) if len(self.stands) == len(share) else torch.zeros_like(share)
        mean, self.stands = self._turning(before, share, self.control_dt)
        return mean

    def get_extra_state(self) -> Tensor:
        """Where the servos stand."""
        return self.stands

    def set_extra_state(self, state: Tensor) -> None:
        """Take up where the servos stood; called by ``load_state_dict``."""
        self.stands = state.clone()
