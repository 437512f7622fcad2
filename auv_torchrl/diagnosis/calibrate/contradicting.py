"""Poses of a healthy flight that its own velocities contradict: nothing could be calibrated on both.

A compass that is turned, or a position in a frame of its own, leaves a sound vehicle sound. No force makes a simulator
follow both reports, and windows that are lost would look like a disturbance, or as a vehicle that is not this one.
Every log that is read has been asked already whether velocities give most of its motion (`flightlog/agreement.py`);
here single stretches count, for each one that is lost leads a calibration astray.
"""

from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.axes import followable, restricted
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import CONTRADICTED, FEW_CONTRADICTED
from auv_torchrl.flightlog import POSE, VELOCITY, Episode, Finding, FlightLog, Severity
from auv_torchrl.flightlog.signals import integral
from auv_torchrl.physics.kinematics import matvec, quaternion_from_euler, rotation_and_rate
from auv_torchrl.quantities import quantity

STRETCH_S = 2.0  # s over which both are compared, as long as windows are
FEWEST = 10  # stretches that tell how often they differ
PLACE, TURN = POSE[:3], POSE[3:]


def healthy_flight(log: FlightLog) -> FlightLog:
    """A healthy flight as it can be followed, less positions, or positions and attitudes, that velocities contradict.

    A finding says so. Where positions, attitudes and all velocities are not measured together, nothing is compared.

    Raises:
        FlightLogError: as :func:`~auv_torchrl.diagnosis.axes.followable`.
    """
    flight = followable(log)
    if not {*POSE, *VELOCITY} <= set(flight.axes):
        return flight
    place, turn = (np.concatenate(sizes) for sizes in zip(*map(_differences, flight.episodes), strict=True))
    told, left_out = [], ()
    if _are_many(place):
        told, left_out = [_told(PLACE, place, "m")], PLACE
    if _are_many(turn):  # a velocity is turned by the attitude before it is a position's
        told, left_out = [*told, _told(TURN, turn, "rad")], POSE
    if not told:
        return flight
    sentence = (
        f"{' and '.join(told)} contradict the velocities of this healthy flight: it is followed by its velocities, and "
        f"{', '.join(left_out)} are left out"
    )
    remedy = "Log positions, attitudes and velocities in the frames that the documentation says"
    finding = Finding(Severity.WARNING, "healthy_contradicts_itself", sentence, remedy, left_out)
    rest = tuple(axis for axis in flight.axes if axis not in left_out)
    return restricted(replace(flight, findings=(*flight.findings, finding)), rest)


def _are_many(sizes: Floats) -> bool:
    return len(sizes) >= FEWEST and bool(np.mean(sizes > CONTRADICTED) > FEW_CONTRADICTED)


def _told(axes: tuple[str, ...], sizes: Floats, unit: str) -> str:
    return f"{', '.join(axes)} (by {quantity(float(np.median(sizes)), unit, 2)} within {STRETCH_S:g} s)"


def _differences(episode: Episode) -> tuple[Floats, Floats]:
    """By how much positions in m, and attitudes in rad, part ways with velocities over each stretch, (N,) each."""
    seen = np.isfinite(episode.pose).all(1) & np.isfinite(episode.velocity).all(1)
    t, pose, velocity = episode.t[seen], episode.pose[seen], episode.velocity[seen]
    if not len(t):
        return np.empty(0), np.empty(0)
    quaternion = quaternion_from_euler(*pose[:, 3:].T)
    side = np.sign((quaternion[1:] * quaternion[:-1]).sum(1))  # both signs of a quaternion are one attitude
    quaternion = quaternion * np.cumprod(np.append(1.0, side))[:, None]
    rotation, turning = rotation_and_rate(quaternion, velocity[:, 3:])
    place = pose[:, :3] - integral(t, matvec(rotation, velocity[:, :3]))
    turn = 2 * (quaternion - integral(t, turning))  # rad, of small turns
    stretches = np.flatnonzero(np.diff(((t - t[0]) / STRETCH_S).astype(int))) + 1
    return _spans(place, stretches), _spans(turn, stretches)


def _spans(values: Floats, edges: np.ndarray) -> Floats:
    """How far values (T, k) range within each stretch."""
    return np.array([np.linalg.norm(np.ptp(part, axis=0)) for part in np.split(values, edges)])
