"""One gradient step of soft actor-critic: all losses, one optimiser, target networks."""

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.objectives import SACLoss, SoftUpdate


class FusedSoftUpdate(SoftUpdate):
    """``SoftUpdate`` in one call over all tensors: 4 us instead of 145 us for twin critics."""

    def __init__(self, loss: SACLoss, *, tau: float):
        super().__init__(loss, tau=tau)
        self._share = tau
        self._online = [p.data for p in leaves(loss, "qvalue_network_params")]
        self._target = [p.data for p in leaves(loss, "target_qvalue_network_params")]

    def step(self) -> None:
        """Move the target critics towards the critics."""
        torch._foreach_lerp_(self._target, self._online, self._share)  # pyright: ignore[reportPrivateImportUsage]


class Updater:
    """Steps actor, critics and temperature together, then moves the target critics by ``tau``.

    The three losses have no parameter in common, so one backward pass and one fused Adam serve them all.
    """

    def __init__(self, loss: SACLoss, learning_rate: float, alpha_learning_rate: float, tau: float):
        self.loss = loss
        self.target_update = FusedSoftUpdate(loss, tau=tau)
        self.learning_rates = (learning_rate, alpha_learning_rate)
        networks = [p for name, p in loss.named_parameters() if name != "log_alpha"]
        groups = [
            {"params": networks, "lr": learning_rate},
            {"params": [loss.log_alpha], "lr": alpha_learning_rate},
        ]
        self.optimiser = torch.optim.Adam(groups, fused=True)

    def step(self, batch: TensorDictBase, actor: bool = True) -> TensorDictBase:
        """Update once on a batch (B,), without ``actor`` the critics alone; returns losses, ``alpha``, ``entropy``."""
        losses = self.loss(batch)
        self.optimiser.zero_grad(set_to_none=True)
        total = losses["loss_qvalue"]
        if actor:
            total = losses["loss_actor"] + total + losses["loss_alpha"]
        total.backward()
        self.optimiser.step()
        self.target_update.step()
        return losses

    def scale_learning_rate(self, factor: float) -> None:
        """Set the learning rates to ``factor`` times their initial values."""
        for group, initial in zip(self.optimiser.param_groups, self.learning_rates, strict=True):
            group["lr"] = initial * factor

    def state_dict(self) -> dict:
        """Everything that the next step depends on."""
        return {"loss": self.loss.state_dict(), "optimiser": self.optimiser.state_dict()}

    def load_state_dict(self, state: dict) -> None:
        """Go on from :meth:`state_dict`."""
        self.loss.load_state_dict(state["loss"])
        self.optimiser.load_state_dict(state["optimiser"])


def leaves(loss: SACLoss, network: str) -> list[Tensor]:
    """The tensors of one of the loss's networks, in a fixed order."""
    return list(getattr(loss, network).values(include_nested=True, leaves_only=True))
