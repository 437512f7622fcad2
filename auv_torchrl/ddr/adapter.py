"""The adapter of DDR: the source policy's action through F, R and H to the target's command, and G learnt in flight."""

from typing import Any, cast

import torch
from tensordict import TensorDictBase
from torch import Tensor

from auv_torchrl.ddr.actuation import Channels, Thrusters
from auv_torchrl.ddr.affine import AffineMap
from auv_torchrl.ddr.config import AdapterConfig
from auv_torchrl.ddr.dither import Dither
from auv_torchrl.ddr.learner import LearnerPerVehicle, MapLearner
from auv_torchrl.ddr.models import SourceModels
from auv_torchrl.ddr.network import NetworkMap
from auv_torchrl.ddr.servos import Servos
from auv_torchrl.ddr.transform import CommandMap


class DDRAdapter(CommandMap):
    """u_t = H(x, u_s(x)), or H(x, R(x, F(x, u_s(x)))): what the target executes for the source policy's action.

    While :attr:`learning`, every true transition updates the map and a dither is added as long as the map is uncertain.
    Networks, bag, modes, the dither and where servos stand are in ``state_dict``.

    Args:
        models: F and R of the source vehicle.
        config: settings; ``map: thrusters`` needs an environment whose actions are thruster commands.
        count: number of vehicles N, where the settings ask for a map for each; one shared map serves any number.
    """

    def __init__(self, models: SourceModels, config: AdapterConfig | None = None, count: int = 1):
        super().__init__(reads=("quaternion", "velocity"))
        self.config = config or AdapterConfig()
        self.models = models
        self.count = 1 if self.config.shared else count
        learners = [MapLearner(make_map(models, self.config), models.states, self.config) for _ in range(self.count)]
        self.learner: Any = learners[0] if self.config.shared else LearnerPerVehicle(learners)
        self.dither = Dither(self.config.seed, self.config.dither_steps)
        self.register_buffer("_learning", torch.zeros((), dtype=torch.bool))
        self.servos = Servos(models.actuation, models.control_dt) if models.actuation.terms.servos else None

    @property
    def learning(self) -> bool:
        """Whether transitions change the map."""
        return bool(self._learning)

    @learning.setter
    def learning(self, value: bool) -> None:
        cast(Tensor, self._learning).fill_(bool(value))

    @property
    def maps(self) -> tuple[AffineMap, ...]:
        """G, whose :meth:`AffineMap.invert` is H: the one, or that of each vehicle."""
        return self.learner.maps

    @property
    def g(self) -> AffineMap:
        """G of all vehicles.

        Raises:
            ValueError: if each of several vehicles has its own.
        """
        if self.count > 1:
            raise ValueError(
                f"adapter.shared=false: there are {self.count} maps, one for each vehicle: take one of "
                "adapter.maps, or give adapter.shared=true"
            )
        return self.maps[0]

    @property
    def outputs(self) -> int:
        """Number of commands."""
        return self.maps[0].space.size

    @property
    def channels(self) -> int:
        """Number of channels."""
        return self.models.actuation.channels

    @torch.no_grad()
    def translate(self, state: Tensor, action: Tensor) -> Tensor:
        """Commands (N, k) in [-1, 1] for the source policy's actions (N, a) in states x (N, s)."""
        tau = torch.nan_to_num(action, nan=0.0).clamp(-1.0, 1.0)
        if self.config.composition == "long":
            tau = self.models.R(state, self.models.F(state, tau))
        else:
            tau = self.models.actuation.intended(tau)
        control, space = self.learner.invert(state, tau), self.maps[0].space
        uncertain = self.learner.uncertain
        if self.config.dither > 0 and self.learning and uncertain.any():
            dither = self.config.dither * self.dither.signs(control.shape).to(control)
            control = torch.where(uncertain, space.shrink(control + dither), control)
        command = space.decode(control)
        sane = (action.isfinite().all(-1) & command.isfinite().all(-1))[:, None]
        return torch.where(sane, command, 0.0)

    def command(self, action: Tensor, *measured: Tensor) -> Tensor:
        """Commands (N, k) for the action and the measured quaternion and velocity."""
        return self.translate(self.models.state_of(*measured).float(), action)

    def begin(self, rows: Tensor, tensordict: TensorDictBase) -> None:
        """Servos of vehicles that begin stand in their middle."""
        if self.servos is not None:
            self.servos.begin(rows, len(tensordict.get("observation")))

    def after_step(self, command: Tensor, before: TensorDictBase, after: TensorDictBase) -> None:
        """Follow the servos, and learn from the transition."""
        turned = None if self.servos is None else self.servos.follow(self.maps[0].space.delivered(command))
        if not self.learning:
            return
        valid = ~after.get("terminated")[..., 0]
        stepped = before.get("_step", None)
        if stepped is not None:
            valid = valid & stepped.reshape(valid.shape)
        now, then = self._motion(before), self._motion(after)
        self.learner.observe(now, command, self.models.R(now, then), valid, turned)

    def _motion(self, tensordict: TensorDictBase) -> Tensor:
        return self.models.state_of(*(tensordict.get(key) for key in self.out_keys_inv[1:])).float()


def make_map(models: SourceModels, config: AdapterConfig) -> AffineMap:
    """G and H as the settings say, starting as the healthy vehicle's."""
    if config.map == "network":
        return NetworkMap(
            Channels(models.actuation), config.ridge, models.states, config.hidden, config.network_steps, config.seed
        )
    space = Thrusters(models.actuation) if config.map == "thrusters" else Channels(models.actuation)
    return AffineMap(space, config.ridge)
