"""A flight log of a target vehicle: what a team would record before it asks for a diagnosis.

A vehicle that hovers is filmed in a tank: place and heading are logged. One at speed carries what its controller
reads, and logs its pose and its velocity.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch
from tensordict import TensorDictBase
from torch import Tensor

from auv_torchrl.compensation.excitation import Excitation
from auv_torchrl.compensation.known_vehicle import Model
from auv_torchrl.envs import FleetEnv
from auv_torchrl.evaluation import draw_starts, roll_out
from auv_torchrl.flightlog import Episode, FlightLog
from auv_torchrl.physics.kinematics import euler_angles, wrap_angle
from auv_torchrl.physics.thrusters import thrust_target
from auv_torchrl.simulator import at_rest
from auv_torchrl.tasks import Task, cruise_speed
from auv_torchrl.vehicle import Vehicle

POSITION_NOISE = 0.002  # m, a motion-capture system under water
ATTITUDE_NOISE = 0.004  # rad
SPEED_NOISE = np.repeat((0.01, 0.005), 3)  # m/s, a Doppler log; rad/s, gyros
POSE = ("x", "y", "z", "roll", "pitch", "yaw")
FILMED = ("x", "y", "z", "yaw")  # what is logged of a vehicle that hovers
CARRIED = (*POSE, "u", "v", "w", "p", "q", "r")  # and of one at speed
DEMAND = 0.3  # amplitude of each wave, of full command
WAVES = 3  # per channel
PERIODS_S = (2.0, 12.0)  # of the waves
LEVELS = 201  # of the demand ahead that are looked at: half a per cent apart


class Stick:
    """Moves every channel slowly to and fro, without looking where the vehicle goes: nothing it can do wrong.

    Args:
        middle: (a,) channels about which it moves.
        flights: number of vehicles N.
        generator: of the waves.
    """

    def __init__(self, middle: Tensor, flights: int, generator: torch.Generator):
        shape = (flights, len(middle), WAVES)
        self.middle = middle
        low, high = PERIODS_S
        self.rate = 2 * math.pi / (low + (high - low) * torch.rand(shape, generator=generator))
        self.phase = 2 * math.pi * torch.rand(shape, generator=generator)

    def __call__(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write ``action`` (N, a) for ``time`` (N, 1)."""
        wave = torch.sin(self.rate * tensordict["time"].float()[..., None] + self.phase).sum(-1)
        return tensordict.set("action", (self.middle + DEMAND * wave).clamp(-1.0, 1.0))


def cruising(vehicle: Vehicle, task: Task) -> Tensor:
    """Channels (a,) that keep a sound vehicle (empty batch) at the speed of its task; 0 of one that hovers."""
    channels = torch.zeros(len(task.axes))
    speed = cruise_speed(task)
    if speed == 0.0 or "surge" not in task.axes:
        return channels
    model, demand = Model.of(vehicle), np.linspace(0.0, 1.0, LEVELS)
    state = at_rest(np.zeros((LEVELS, 3)), np.zeros(LEVELS), vehicle.thrusters)
    state.velocity[:, 0] = speed
    thrust = thrust_target(model.c, model.terms, demand[:, None] * vehicle.mixer[:, 0])
    ahead = model.rate(state, thrust)[:, 0]  # grows with the demand
    channels[task.axes.index("surge")] = float(np.interp(0.0, ahead, demand))
    return channels


def fly_target_log(
    make_fleet: Callable[[Task, int], FleetEnv], nominal: Vehicle, task: Task, excitation: Excitation, name: str
) -> FlightLog:
    """Fly target vehicles with the stick, from rest or from their speed, and log commands and what is measured.

    Args:
        make_fleet: makes a fleet of that many target vehicles for a task.
        nominal: one vehicle (empty batch), what they are taken for.
        task: of the evaluation.
        excitation: how long.
        name: of the log.
    """
    task = replace(task, episode_s=excitation.episode_s, start_speed=0.0, start_yaw_rate=0.0, thruster_commands=False)
    count = excitation.episodes
    stick = Stick(cruising(nominal, task), count, torch.Generator().manual_seed(excitation.seed))
    fleet = make_fleet(task, count)
    rollout = roll_out(fleet, stick, draw_starts(task, count, excitation.seed), task.steps)
    noise = np.repeat((POSITION_NOISE, ATTITUDE_NOISE), 3)
    rng = np.random.default_rng(excitation.seed)
    axes = CARRIED if cruise_speed(task) else FILMED
    hidden = [axis not in axes for axis in CARRIED]
    episodes = []
    for number in range(count):
        flown = rollout[number]
        position, quaternion = (flown["measured", key].double().numpy() for key in ("position", "quaternion"))
        pose = np.concatenate((position, np.stack(euler_angles(quaternion), axis=-1)), axis=-1)
        pose = pose + noise * rng.standard_normal(pose.shape)
        pose[:, 3:] = wrap_angle(pose[:, 3:])
        velocity = flown["measured", "velocity"].double().numpy()
        velocity = velocity + (SPEED_NOISE * rng.standard_normal(velocity.shape) if axes == CARRIED else 0.0)
        pose[:, hidden[:6]], velocity[:, hidden[6:]] = np.nan, np.nan
        sent = flown["next", "command"].double().numpy()  # over the step that begins at each sample
        t = task.control_dt * np.arange(len(pose), dtype=np.float64)
        episodes.append(Episode(number, t, pose, velocity, sent))
    return FlightLog(name, tuple(episodes), axes)
