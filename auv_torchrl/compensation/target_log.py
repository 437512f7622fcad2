"""A flight log of a target vehicle: what a team would record before it asks for a diagnosis."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch
from tensordict import TensorDictBase

from auv_torchrl.compensation.excitation import Excitation
from auv_torchrl.envs import FleetEnv
from auv_torchrl.evaluation import draw_starts, roll_out
from auv_torchrl.flightlog import Episode, FlightLog
from auv_torchrl.physics.kinematics import euler_angles, wrap_angle
from auv_torchrl.tasks import Task

POSITION_NOISE = 0.002  # m, a motion-capture system under water
ATTITUDE_NOISE = 0.004  # rad
AXES = ("x", "y", "z", "yaw")  # what is logged of the pose
DEMAND = 0.3  # amplitude of each wave, of full command
WAVES = 3  # per channel
PERIODS_S = (2.0, 12.0)  # of the waves


class Stick:
    """Moves every channel slowly to and fro, without looking where the vehicle goes: nothing it can do wrong."""

    def __init__(self, flights: int, generator: torch.Generator):
        shape = (flights, 4, WAVES)
        low, high = PERIODS_S
        self.rate = 2 * math.pi / (low + (high - low) * torch.rand(shape, generator=generator))
        self.phase = 2 * math.pi * torch.rand(shape, generator=generator)

    def __call__(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write ``action`` (N, 4) for ``time`` (N, 1)."""
        wave = torch.sin(self.rate * tensordict["time"].float()[..., None] + self.phase).sum(-1)
        return tensordict.set("action", (DEMAND * wave).clamp(-1.0, 1.0))


def fly_target_log(
    make_fleet: Callable[[Task, int], FleetEnv], task: Task, excitation: Excitation, name: str
) -> FlightLog:
    """Fly target vehicles with the stick, from rest, and log commands and measured poses.

    Args:
        make_fleet: makes a fleet of that many target vehicles for a task.
        task: of the evaluation.
        excitation: how long.
        name: of the log.
    """
    task = replace(task, episode_s=excitation.episode_s, start_speed=0.0, start_yaw_rate=0.0, thruster_commands=False)
    count = excitation.episodes
    stick = Stick(count, torch.Generator().manual_seed(excitation.seed))
    fleet = make_fleet(task, count)
    rollout = roll_out(fleet, stick, draw_starts(task, count, excitation.seed), task.steps)
    noise = np.repeat((POSITION_NOISE, ATTITUDE_NOISE), 3)
    rng = np.random.default_rng(excitation.seed)
    hidden = [axis not in AXES for axis in ("x", "y", "z", "roll", "pitch", "yaw")]
    episodes = []
    for number in range(count):
        flown = rollout[number]
        position, quaternion = (flown["measured", key].double().numpy() for key in ("position", "quaternion"))
        pose = np.concatenate((position, np.stack(euler_angles(quaternion), axis=-1)), axis=-1)
        pose = pose + noise * rng.standard_normal(pose.shape)
        pose[:, 3:] = wrap_angle(pose[:, 3:])
        pose[:, hidden] = np.nan
        sent = flown["next", "command"].double().numpy()  # over the step that begins at each sample
        t = task.control_dt * np.arange(len(pose), dtype=np.float64)
        episodes.append(Episode(number, t, pose, np.full_like(pose, np.nan), sent))
    return FlightLog(name, tuple(episodes), AXES)
