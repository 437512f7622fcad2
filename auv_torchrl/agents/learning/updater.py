"""One gradient step of an agent that learns from a replay buffer: all losses, one optimiser, target networks."""

from abc import ABC, abstractmethod

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.objectives import LossModule, SACLoss, SoftUpdate, TD3Loss

from auv_torchrl.agents.learning.fused import ClosedForm, FusedSACLoss, FusedSoftUpdate, leaves


class Updater(ABC):
    """Steps all networks of a loss module, then moves their targets.

    The losses have no parameter in common, so one backward pass and one fused Adam serve them all.
    """

    curves: tuple[str, ...]  # entries of the losses that the learning curve shows

    def __init__(self, loss: LossModule, groups: list[dict]):
        self.loss = loss
        self.learning_rates = [group["lr"] for group in groups]
        self.optimiser = torch.optim.Adam(groups, fused=True)

    @property
    def actor(self) -> list[Tensor]:
        """Weights of the actor, which steps change in place."""
        return [p.data for p in leaves(self.loss, "actor_network_params")]

    @abstractmethod
    def step(self, batch: TensorDictBase, actor: bool = True) -> TensorDictBase:
        """Update once on a batch (B,), without ``actor`` the critics alone; returns the losses."""

    def _descend(self, total: Tensor) -> None:
        self.optimiser.zero_grad(set_to_none=True)
        total.backward()
        self.optimiser.step()

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


class SACUpdater(Updater):
    """Actor, critics and temperature together, then the target critics by ``tau``.

    A :class:`FusedSACLoss` is stepped by its own gradients and target update, any other one by autograd and TorchRL's.
    """

    curves = ("loss_qvalue", "loss_actor", "alpha", "entropy")

    def __init__(self, loss: SACLoss, learning_rate: float, alpha_learning_rate: float, tau: float):
        networks = [p for name, p in loss.named_parameters() if name != "log_alpha"]
        groups = [
            {"params": networks, "lr": learning_rate},
            {"params": [loss.log_alpha], "lr": alpha_learning_rate},
        ]
        super().__init__(loss, groups)
        fused = isinstance(loss, FusedSACLoss)
        self.target_update = FusedSoftUpdate(loss, tau=tau) if fused else SoftUpdate(loss, tau=tau)
        self._closed_form = ClosedForm(loss) if fused and loss.has_closed_form else None

    def step(self, batch: TensorDictBase, actor: bool = True) -> TensorDictBase:
        """As of every updater."""
        if self._closed_form is not None:
            losses = self._closed_form(batch, actor)
            self.optimiser.step()
        else:
            losses = self.loss(batch)
            total = losses["loss_qvalue"]
            self._descend(losses["loss_actor"] + total + losses["loss_alpha"] if actor else total)
        self.target_update.step()
        return losses


class TD3Updater(Updater):
    """The critics at every step; actor and targets at every ``actor_every``-th (Fujimoto et al. 2018)."""

    curves = ("loss_qvalue", "loss_actor")

    def __init__(self, loss: TD3Loss, learning_rate: float, tau: float, actor_every: int):
        super().__init__(loss, [{"params": list(loss.parameters()), "lr": learning_rate}])
        self.target_update = SoftUpdate(loss, tau=tau)
        self.actor_every, self.steps = actor_every, 0

    def step(self, batch: TensorDictBase, actor: bool = True) -> TensorDictBase:
        """As of every updater."""
        self.steps += 1
        moved = self.steps % self.actor_every == 0
        losses = self.loss(batch)
        self._descend(losses["loss_actor"] + losses["loss_qvalue"] if actor and moved else losses["loss_qvalue"])
        if moved:
            self.target_update.step()
        return losses

    def state_dict(self) -> dict:
        """Everything that the next step depends on."""
        return {**super().state_dict(), "steps": self.steps}

    def load_state_dict(self, state: dict) -> None:
        """Go on from :meth:`state_dict`."""
        super().load_state_dict(state)
        self.steps = state["steps"]
