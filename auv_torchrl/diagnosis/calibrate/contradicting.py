"""Poses of a healthy flight that its own velocities contradict: nothing could be calibrated on both.

A compass that is turned, or a position in a frame of its own, leaves a sound vehicle sound. No force makes a simulator
follow both reports, and windows that are lost would look like a disturbance, or as a vehicle that is not this one.
"""

from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.axes import restricted
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import CONTRADICTED, FEW_CONTRADICTED
from auv_torchrl.flightlog import POSE, Episode, Finding, FlightLog, Severity
from auv_torchrl.physics.kinematics import matvec, quaternion_from_euler, rotation_and_rate

STRETCH_S = 2.0  # s over which both are compared, as long as windows are
FEWEST = 10  # stretches that tell how often they differ
GROUPS = ((("x", "y", "z"), ("u", "v", "w"), "m"), (("roll", "pitch", "yaw"), ("p", "q", "r"), "rad"))


def without_contradictions(flight: FlightLog) -> FlightLog:
    """A healthy flight without positions, or without positions and attitudes, that its velocities contradict.

    A finding says so. Only axes that are measured in both ways are left out: those that tell nothing of their own.
    """
    if not set(POSE) <= set(flight.axes):
        return flight
    left_out, told = [], []
    for (pose, velocity, unit), differs in zip(GROUPS, _differences(flight), strict=True):
        often = np.mean(differs > CONTRADICTED) if len(differs) >= FEWEST else 0.0
        if set(velocity) <= set(flight.axes) and often > FEW_CONTRADICTED:
            left_out += pose
            told.append(f"{', '.join(pose)} (by {np.median(differs):.2g} {unit} within {STRETCH_S:g} s)")
    if "roll" in left_out and "x" not in left_out:  # a velocity is turned by the attitude before it is a position's
        left_out = [*GROUPS[0][0], *left_out] if set(GROUPS[0][1]) <= set(flight.axes) else []
    if not left_out:
        return flight
    sentence = (
        f"{' and '.join(told)} contradict the velocities of this healthy flight: it is followed by its velocities, and "
        f"{', '.join(left_out)} are left out"
    )
    remedy = "Log positions, attitudes and velocities in the frames that the documentation says"
    finding = Finding(Severity.WARNING, "healthy_contradicts_itself", sentence, remedy, tuple(left_out))
    rest = tuple(axis for axis in flight.axes if axis not in left_out)
    return restricted(replace(flight, findings=(*flight.findings, finding)), rest)


def _differences(flight: FlightLog) -> tuple[Floats, Floats]:
    """By how much positions in m and attitudes in rad depart from velocities over each stretch of a flight."""
    found = [_of_episode(episode) for episode in flight.episodes]
    return np.concatenate([place for place, _ in found]), np.concatenate([turn for _, turn in found])


def _of_episode(episode: Episode) -> tuple[Floats, Floats]:
    seen = np.isfinite(episode.pose).all(1) & np.isfinite(episode.velocity).all(1)
    t, pose, velocity = episode.t[seen], episode.pose[seen], episode.velocity[seen]
    if len(t) < FEWEST:
        return np.empty(0), np.empty(0)
    quaternion = quaternion_from_euler(*pose[:, 3:].T)
    rotation, turning = rotation_and_rate(quaternion, velocity[:, 3:])
    signs = np.where(np.cumprod(np.append(1, np.sign((quaternion[1:] * quaternion[:-1]).sum(1)))) < 0, -1.0, 1.0)
    place = pose[:, :3] - _integral(t, matvec(rotation, velocity[:, :3]))
    turn = 2 * (quaternion * signs[:, None] - _integral(t, turning * signs[:, None]))  # rad, of small turns
    stretch = ((t - t[0]) / STRETCH_S).astype(int)
    edges = np.flatnonzero(np.diff(stretch, prepend=-1))
    both = [np.ptp(part, axis=0) for values in (place, turn) for part in np.split(values, edges[1:])]
    sizes = np.linalg.norm(np.stack([np.pad(part, (0, 4 - len(part))) for part in both]), axis=1)
    return sizes[: len(edges)], sizes[len(edges) :]


def _integral(t: Floats, rate: Floats) -> Floats:
    """Of rates (T, k) over times (T,), from nothing on."""
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(t)[:, None]
    return np.concatenate([np.zeros_like(rate[:1]), steps.cumsum(0)])
