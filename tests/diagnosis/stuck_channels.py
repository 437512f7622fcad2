"""Flights of which some channels stand still with noise, while the vehicle flies on."""

from dataclasses import replace

import numpy as np

from auv_torchrl.flightlog import POSE, VELOCITY, FlightLog

SOUND_NOISE = {"x": 0.002, "y": 0.002, "z": 0.002}  # m; of all others 4 mrad or m/s
GROUPS = {"depth": ("z", "w"), "position": ("x", "y"), "heading": ("yaw", "r"), "pose": (*POSE, *VELOCITY)}


def stuck(
    log: FlightLog, channels: tuple[str, ...], size: float = 1.0, stretch: tuple[float, float] | None = None, seed=0
) -> FlightLog:
    """The log with channels that are a constant and white noise, all along or for a stretch of each episode in s.

    The noise is ``size`` times the usual one.
    """
    rng, episodes = np.random.default_rng(seed), []
    for episode in log.episodes:
        pose, velocity = episode.pose.copy(), episode.velocity.copy()
        first, last = stretch or (0.0, np.inf)
        still = (episode.t >= first) & (episode.t < last)
        for channel in channels:
            values, column = (pose, POSE.index(channel)) if channel in POSE else (velocity, VELOCITY.index(channel))
            noise = size * SOUND_NOISE.get(channel, 0.004) * rng.standard_normal(still.sum())
            values[still, column] = values[np.argmax(still), column] + noise
        episodes.append(replace(episode, pose=pose, velocity=velocity))
    return replace(log, episodes=tuple(episodes))


def rocked(log, seed=3):
    """The log of a vehicle on a boat: what its commands were, and a slow rocking with noise in place of its motion."""
    rng, episodes = np.random.default_rng(seed), []
    for episode in log.episodes:
        t, pose = episode.t, np.full_like(episode.pose, np.nan)
        velocity = np.full_like(episode.velocity, np.nan)
        for column, (size, noise, hz) in {0: (0.01, 0.001, 0.31), 1: (0.01, 0.001, 0.27), 2: (0.005, 0.001, 0.33),
                                          5: (0.01, 0.001, 0.28)}.items():  # fmt: skip
            pose[:, column] = size * np.sin(2 * np.pi * hz * t + column) + noise * rng.standard_normal(len(t))
        episodes.append(replace(episode, pose=pose, velocity=velocity))
    return replace(log, episodes=tuple(episodes))
