"""Stretches of a log that a fit flies anew, each from what was measured at its start."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from scipy.signal import savgol_filter

from auv_torchrl.flightlog import POSE, Episode, FlightLog
from auv_torchrl.physics import CONTROL_DT
from auv_torchrl.physics.kinematics import matvec, quaternion_from_euler, rotation_matrix

SEEN = ("x", "y", "z", "yaw")  # what the logs hold of a pose
NOISE = np.array([0.002, 0.002, 0.002, 0.004])  # m, rad; standard deviation of the logs' noise, as in sensor_sets
# Of windows of 0.5 to 3 s, these are the longest in which a fit from nominal finds a thruster that pushes backwards.
FIT_S = 0.75
EVERY_S = 1.5  # from one window that is fitted to the next: all of them take twice as long
HELD_S = 2.0  # of a window that is predicted
MEMORY = 12  # rows of commands before a window: a delay of 0.5 s reaches back that far
# Rows of the cubic that gives pose and speed of a start. Of 7 to 21, 11 miss the next 2 s of sound vehicles least.
SMOOTHED = 11
ORDER = 3


class Windows(NamedTuple):
    """Windows (W) of S rows."""

    start: np.ndarray  # (W, 12) reported pose and body velocity
    time: np.ndarray  # (W,) s into the episode
    commands: np.ndarray  # (W, MEMORY + S, n) sent, from MEMORY rows before the start
    measured: np.ndarray  # (W, S, 4) of SEEN, one row after the start and on

    @property
    def steps(self) -> int:
        """Rows of a window."""
        return self.measured.shape[1]


def cut(log: FlightLog, seconds: float, every_s: float) -> Windows:
    """Windows of a log, one every few seconds of each episode."""
    steps, every = round(seconds / CONTROL_DT), round(every_s / CONTROL_DT)
    return _joined(_of_episode(episode, steps, every) for episode in log.episodes)


def wrapped(error: np.ndarray) -> np.ndarray:
    """Differences (..., 4) of what is SEEN, the angle within half a turn."""
    error = error.copy()
    error[..., 3] = (error[..., 3] + np.pi) % (2 * np.pi) - np.pi
    return error


def _of_episode(episode: Episode, steps: int, every: int) -> Windows:
    pose = np.nan_to_num(episode.pose)  # roll and pitch are not logged: level
    pose[:, 3:] = np.unwrap(pose[:, 3:], axis=0)
    even = np.asarray(savgol_filter(pose, SMOOTHED, ORDER, axis=0))
    rate = np.asarray(savgol_filter(pose, SMOOTHED, ORDER, deriv=1, delta=CONTROL_DT, axis=0))
    attitude = quaternion_from_euler(*even[:, 3:].T)
    linear = np.asarray(matvec(rotation_matrix(attitude).mT, rate[:, :3]))
    motion = np.concatenate([even, linear, rate[:, 3:]], axis=1)
    starts = np.arange(MEMORY, len(pose) - steps, every)
    rows = [POSE.index(name) for name in SEEN]
    return Windows(
        motion[starts],
        episode.t[starts],
        np.stack([episode.commands[k - MEMORY : k + steps] for k in starts]),
        np.stack([pose[k + 1 : k + steps + 1, rows] for k in starts]),
    )


def _joined(parts: Iterable[Windows]) -> Windows:
    return Windows(*(np.concatenate(part) for part in zip(*parts, strict=True)))
