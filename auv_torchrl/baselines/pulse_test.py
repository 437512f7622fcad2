"""Pulse every thruster on its own and correct its sign: what ArduSub's motor direction detection does.

Reference: ArduSub 4.0, "Automatic Motor Direction Detection".
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict
from torch import Tensor

from auv_torchrl.adaptation.motion import SourceMotion
from auv_torchrl.adaptation.transform import Array, ThrusterTransform
from auv_torchrl.envs import FleetEnv
from auv_torchrl.quantities import counted
from auv_torchrl.vehicle import CONTROLLED_INDEX, Vehicle

PULSE_S = 0.3
PAUSE_S = 0.7  # until the vehicle is nearly at rest again
PULSE = 0.4  # share of full command
CLEARLY = 0.2  # of the expected change; less is the vehicle drifting


@dataclass(frozen=True)
class PulseTest:
    """What the pulses showed."""

    signs: Tensor  # (n,) +1 as wired, -1 reversed; a thruster without any effect keeps +1
    target_data_s: float


def pulse_test(fleet: FleetEnv, source: Vehicle) -> PulseTest:
    """Pulse each thruster of one target vehicle from rest and compare the direction it moves with the expected one.

    Args:
        fleet: one target vehicle that takes thruster commands.
        source: the nominal vehicle (empty batch).

    Raises:
        ValueError: for a fleet of more than one vehicle, or one that takes channels.
    """
    if fleet.num_envs != 1 or not fleet.task.thruster_commands:
        raise ValueError(
            f"pulse test: the fleet has {counted(fleet.num_envs, 'vehicle')} and thruster_commands="
            f"{fleet.task.thruster_commands}: give one vehicle that takes thruster commands"
        )
    dt = fleet.task.control_dt
    motion = SourceMotion(source, dt)
    still = np.zeros((1, 4))
    by_wrench = motion(still, still).by_wrench[0, 4:]
    tensordict = fleet.reset(_at_rest(), set_state=True)
    signs = torch.ones(source.thrusters)
    pulse, pause = round(PULSE_S / dt), round(PAUSE_S / dt)

    def hold(tensordict: Any, command: torch.Tensor, steps: int) -> Any:
        for _ in range(steps):
            tensordict["action"] = command
            tensordict = fleet.step_mdp(fleet.step(tensordict))
        return tensordict

    for thruster in range(source.thrusters):
        command = torch.zeros(1, source.thrusters)
        command[0, thruster] = PULSE
        before = _velocity(tensordict)
        tensordict = hold(tensordict, command, pulse)
        change = _velocity(tensordict) - before
        expected = PULSE * pulse * by_wrench @ motion.per_share[:, thruster]
        if float(change @ expected / (expected @ expected)) < -CLEARLY:
            signs[thruster] = -1.0
        tensordict = hold(tensordict, torch.zeros_like(command), pause)
    return PulseTest(signs, source.thrusters * (pulse + pause) * dt)


class FixedSigns(ThrusterTransform):
    """The mixer's commands with the sign of each thruster corrected once and for all.

    Args:
        vehicle: one vehicle (empty batch), the source.
        signs: (n,) from :func:`pulse_test`.
    """

    signs: Tensor

    def __init__(self, vehicle: Vehicle, signs: Tensor):
        super().__init__(vehicle)
        self.register_buffer("signs", signs.clone())

    def thrusts(self, nominal: Array) -> Array:
        """The nominal thrusts (N, n) with corrected signs."""
        return nominal * self.signs.double().numpy()


def _at_rest() -> TensorDict:
    upright = torch.tensor([[1.0, 0.0, 0.0, 0.0]], dtype=torch.float64)
    start = {"position": torch.zeros(1, 3), "quaternion": upright, "velocity": torch.zeros(1, 6)}
    return TensorDict({"start": TensorDict(start, [1])}, [1])


def _velocity(tensordict: Any) -> Array:
    return tensordict["velocity"][0, list(CONTROLLED_INDEX)].double().numpy()
