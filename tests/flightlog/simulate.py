"""Flight logs made with the project's physics, so that what is in them is known."""

import numpy as np
import torch

from auv_torchrl.effects import get_effect
from auv_torchrl.flightlog import Episode, FlightLog
from auv_torchrl.physics import CONTROL_DT, ActiveTerms, control_step, prepare, rest_state
from auv_torchrl.physics.kinematics import euler_angles, quaternion_from_euler
from auv_torchrl.physics.step import memory_length
from auv_torchrl.sensors import measured_pose, measured_velocity
from auv_torchrl.vehicle import CONTROLLED_INDEX, load_vehicle

POSE_ONLY = ("x", "y", "z", "yaw")
LONGEST_DELAY = 0.8


def waves(rng: np.random.Generator, steps: int, channels: int, size: float = 0.35) -> np.ndarray:
    """Sums of three slow sines per channel, (steps, channels)."""
    t = np.arange(steps)[:, None, None] * CONTROL_DT
    period, phase = rng.uniform(2, 12, (1, channels, 3)), rng.uniform(0, 2 * np.pi, (1, channels, 3))
    return size * np.sin(2 * np.pi * t / period + phase).sum(-1)


def simulated_logs(name, changes, episodes=2, seconds=30.0, noise=(2e-3, 4e-3), seed=0):
    """One log per entry of ``changes`` (a list of {effect: values}), pose and velocity, flown as one batch."""
    nominal = load_vehicle(name)
    rows = []
    for change in changes:
        vehicle = nominal
        for effect, values in change.items():
            vehicle = get_effect(effect).apply(vehicle, values)
        rows += [vehicle] * episodes
    vehicles = torch.stack(rows)
    c = prepare(vehicles).numpy()
    terms = ActiveTerms.of(c)
    rng = np.random.default_rng(seed)
    batch, steps, n = len(rows), round(seconds / CONTROL_DT), nominal.thrusters
    memory = memory_length(LONGEST_DELAY)
    demand = np.zeros((batch, steps, 6))
    demand[..., CONTROLLED_INDEX] = [waves(rng, steps, 4) for _ in range(batch)]
    commands = np.clip(demand @ nominal.mixer.numpy().T, -1, 1)
    yaw = rng.uniform(-np.pi, np.pi, batch)
    state = rest_state(
        rng.normal(size=(batch, 3)), quaternion_from_euler(0 * yaw, 0 * yaw, yaw), np.zeros((batch, 6)), n, memory
    )
    c = c._replace(position_noise=c.position_noise + noise[0], attitude_noise=c.attitude_noise + noise[1])
    poses = np.repeat(np.concatenate((state.position, state.quaternion), -1)[:, None], memory, axis=1)
    seen, velocity = [], []
    for step in range(steps):
        position, quaternion = measured_pose(c, poses, CONTROL_DT, rng.normal(size=(batch, 6)))
        seen.append(np.concatenate((position, np.stack(euler_angles(quaternion), -1)), -1))
        velocity.append(measured_velocity(c, state.velocity) + noise[0] * rng.normal(size=(batch, 6)))
        state = control_step(c, terms, state, commands[:, step])
        pose = np.concatenate((state.position, state.quaternion), -1)
        poses = np.concatenate((pose[:, None], poses[:, :-1]), axis=1)
    pose, velocity = np.stack(seen, 1), np.stack(velocity, 1)
    t = np.arange(steps) * CONTROL_DT
    axes = ("x", "y", "z", "roll", "pitch", "yaw", "u", "v", "w", "p", "q", "r")
    flown = [Episode(row % episodes, t, pose[row], velocity[row], commands[row]) for row in range(batch)]
    return [FlightLog(f"log {k}", tuple(flown[k * episodes : (k + 1) * episodes]), axes) for k in range(len(changes))]
