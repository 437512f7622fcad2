"""Between a policy of channels and an environment of thruster commands: what every map to the thrusters shares."""

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from tensordict import TensorDictBase
from torch import Tensor

from auv_torchrl.ddr.actuation import Actuation
from auv_torchrl.ddr.transform import CommandMap
from auv_torchrl.envs.start import BODY, EXPECTED, MEASURED, TIME
from auv_torchrl.physics import ActiveTerms, prepare
from auv_torchrl.physics.thrusters import thrust_target
from auv_torchrl.tasks import Task, cruise_speed
from auv_torchrl.vehicle import Vehicle

Array = Any


class ThrusterTransform(CommandMap):
    """Turns channels (N, a) into thruster commands (N, n), on numpy.

    A map says which thrusts it wants (:meth:`thrusts`) and may learn from every step (:meth:`learn`).

    Args:
        vehicle: one vehicle (empty batch), the source.
        task: of the environment, for its axes and speed; None for one that hovers.
        reports: entries that the map writes beside ``applied_action``.
    """

    def __init__(self, vehicle: Vehicle, task: Task | None = None, reports: Sequence[str] = ()):
        super().__init__(reports=reports)
        self.actuation = Actuation(vehicle) if task is None else Actuation(vehicle, task.axes, cruise_speed(task))
        c = prepare(vehicle)
        self._terms, self._coefficients = ActiveTerms.of(c), c
        self._mixer = array(self.actuation.mixer)

    @property
    def thrusters(self) -> int:
        """Number of thrusters n."""
        return self.actuation.thrusters

    @property
    def outputs(self) -> int:
        """The same: each thruster gets a command."""
        return self.thrusters

    @property
    def channels(self) -> int:
        """Number of channels."""
        return self.actuation.channels

    @abstractmethod
    def thrusts(self, nominal: Array) -> Array:
        """Thrusts (N, n), shares of full thrust, where the source vehicle would get ``nominal`` (N, n); numpy."""

    def withheld(self, wanted: Array, command: Array) -> None:
        """Called with the thrusts (N, n) that were wanted and the commands (N, n) given for them; does nothing."""

    def learn(self, share: Array, before: TensorDictBase, after: TensorDictBase) -> None:
        """Called after every step with the thrusts (N, n) that were commanded; may write to ``after``; does nothing."""

    def delivered(self, command: Array) -> Array:
        """Thrusts (N, n), shares of full thrust, that commands (N, n) give on the source vehicle; numpy."""
        return thrust_target(self._coefficients, self._terms, command) / self._coefficients.full_thrust

    def command_for(self, wanted: Array) -> Array:
        """Commands (N, n) that give thrusts (N, n), shares of full thrust, on the source vehicle; numpy."""
        device = self.actuation.mixer.device
        return array(self.actuation.command_for(torch.from_numpy(wanted.astype(np.float32)).to(device)))

    @torch.no_grad()
    def translate(self, action: Tensor) -> Tensor:
        """Thruster commands (N, n) in [-1, 1] for the source policy's actions (N, a)."""
        channels = array(action)
        sane = np.isfinite(channels).all(-1, keepdims=True)
        channels = np.clip(np.where(sane, channels, 0.0), -1.0, 1.0)
        wanted = self.thrusts(self.delivered(channels @ self._mixer.T))
        command = self.command_for(wanted)
        command = np.where(sane & np.isfinite(command).all(-1, keepdims=True), command, 0.0)
        self.withheld(wanted, command)
        return torch.from_numpy(command.astype(np.float32)).to(action.device)

    def command(self, action: Tensor, *measured: Tensor) -> Tensor:
        """Thruster commands (N, n) for the action alone: what is measured is learnt from after the step."""
        return self.translate(action)

    def after_step(self, command: Tensor, before: TensorDictBase, after: TensorDictBase) -> None:
        """Hand the thrusts that were commanded to :meth:`learn`."""
        self.learn(self.delivered(array(command)), before, after)


def array(tensor: Tensor) -> Array:
    """The tensor as a float64 numpy array."""
    return tensor.detach().cpu().double().numpy()


def measured_state(tensordict: TensorDictBase) -> Array:
    """Measured position, quaternion and velocity (N, 13)."""
    return np.concatenate([array(tensordict.get((MEASURED, key))) for key in BODY], axis=-1)


def set_expected(tensordict: TensorDictBase, state: Array, time: Array) -> None:
    """Report the states (N, 13) and times (N,) that are expected when the next command acts."""
    like = tensordict.get((MEASURED, "position"))
    parts = np.split(np.concatenate((state, time[:, None]), axis=-1), np.cumsum([*BODY.values()]), axis=-1)
    for key, part in zip((*BODY, TIME), parts, strict=True):
        tensordict.set((EXPECTED, key), torch.from_numpy(part).to(like))
