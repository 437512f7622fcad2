"""An exported policy with the place at which it flies: from measured states to commands."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from auv_torchrl.export.flight import ExportedPolicy
from auv_torchrl.fly.safety import Motion
from auv_torchrl.physics.kinematics import heading_of, quaternion_product
from auv_torchrl.vehicle.fields import CONTROLLED


class Flyer:
    """Flies the task of a policy from where the vehicle is: that place and heading are the task's origin and north.

    Args:
        folder: that ``auv-export`` wrote.
        task: another task that the policy sees in the same way, as in ``conf/task``; None for the one of the contract.
        adapted: whether the command passes the maps of a changed vehicle (u_t), where the export has any; else u_s.

    Raises:
        ValueError: for a policy that cannot be flown through ArduSub's inputs.
    """

    def __init__(self, folder: Path, task: Mapping[str, Any] | None = None, adapted: bool = True):
        self.policy = ExportedPolicy(folder, task)
        if not self.policy.contract["vehicle"]["mixed"]:
            raise ValueError(
                f"policy={folder} commands thrusters, and ArduSub takes surge, sway, heave and yaw alone: export a "
                "policy without task.thruster_commands=true, and with adapter=affine or network"
            )
        if self.policy.task.axes != CONTROLLED:
            raise ValueError(
                f"policy={folder} commands {', '.join(self.policy.task.axes)}, and ArduSub takes "
                f"{', '.join(CONTROLLED)}: fly it with auv_torchrl.export.flight, or export a policy of another task"
            )
        if not adapted:
            self.policy.adapter = None
        self.along_s = 0.0  # how far along the task the vehicle is
        self._origin, self._yaw = np.zeros(3), 0.0
        self.command(Motion(0.0, (0.0,) * 3, (1.0, 0.0, 0.0, 0.0), (0.0,) * 6))  # a first run takes longer

    @property
    def control_dt(self) -> float:
        """For how long a command is held, s."""
        return self.policy.control_dt

    @property
    def says(self) -> str:
        """What flies."""
        maps = self.policy.adapter is not None and self.policy.adapter["fitted"]
        return f"policy {self.policy.contract['policy']}, {'u_t' if maps else 'u_s'}, task {self.policy.task.name}"

    def start(self, motion: Motion) -> None:
        """Begin the task where the vehicle is."""
        self._origin = np.array(motion.position)
        self._yaw = float(heading_of(np.array(motion.quaternion)))
        self.along_s = 0.0

    def command(self, motion: Motion) -> list[float]:
        """(4,) surge, sway, heave, yaw; the task goes on by a step, less where the vehicle is kept neutral."""
        position, quaternion, velocity = self._place(motion)
        skipped = self.policy.task.skipped(position, quaternion, velocity, np.array([self.along_s]))
        if skipped is not None:
            self.along_s += float(skipped[0])
        command = self.policy.command(position, quaternion, velocity, np.array([self.along_s]))
        self.along_s += self.control_dt
        return command[0].tolist()

    def off(self, motion: Motion) -> float:
        """How far the vehicle is from where it should be, m."""
        position, _, _ = self._place(motion)
        wanted = self.policy.task.reference(np.array([self.along_s])).position
        return float(np.linalg.norm(wanted - position))

    def _place(self, motion: Motion) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position, quaternion and velocity (1, ...) from the task's origin."""
        c, s = math.cos(self._yaw), math.sin(self._yaw)
        turned = np.array(((c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0))) @ (np.array(motion.position) - self._origin)
        back = np.array((math.cos(self._yaw / 2), 0.0, 0.0, -math.sin(self._yaw / 2)))
        quaternion = quaternion_product(back, np.array(motion.quaternion))
        return turned[None], quaternion[None], np.array(motion.velocity)[None]
