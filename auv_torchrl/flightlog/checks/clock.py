"""Whether a column t that rises by exactly 1 counts seconds, as in a log at 1 Hz, or samples.

Two witnesses, as for frames: d(position)/dt against the measured velocity, and the motion against what the thrusters
give. Counted in samples, a motion is slower than either by the sampling rate.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from auv_torchrl.flightlog.checks.motion import SLOWEST, blocks, responses, rotations
from auv_torchrl.flightlog.findings import Finding, Severity
from auv_torchrl.flightlog.log import Episode
from auv_torchrl.physics.kinematics import matvec
from auv_torchrl.vehicle import Vehicle

_INTERVALS_S = (0.5, 0.25, 0.2, 0.1, 0.05, 0.04, 0.02, 0.01)  # s, sampling intervals that logs usually have
_SLOWER = 0.15  # of the measured velocity: turns within a second leave more than this of a true log at 1 Hz,
_KEEPS_UP = 0.6  # and from here on seconds are sure
_TOO_WEAK = 0.1  # of the push of the thrusters: with less left in all of them a vehicle hardly flies
_ENOUGH = 0.25  # of it, which seconds explain, faults included
_AGREES = 0.5  # correlation of d(position)/dt and velocity from which their sizes are compared,
_CLEARLY = 0.8  # and from which they agree
_FITS = 0.65  # correlation with the thrusters that a sampling interval must give
_NOT_FAR = 3.0  # and the factor by which it may miss the size: a vehicle's file is a guess


def check_clock(episodes: tuple[Episode, ...], vehicle: Vehicle) -> list[Finding]:
    """A finding where t counts samples, or may do so; none where the motion agrees with seconds."""
    if any((np.diff(episode.t) != 1.0).any() for episode in episodes):
        return []
    by, beat = "its measured velocity", _by_velocity(episodes, vehicle)
    if beat is None:
        by, beat = "its thrusters", _by_thrusters(episodes, vehicle)
    if beat.seconds is False:
        sentence = (
            f"t rises by exactly 1 from row to row, and in seconds the motion is about {1 / beat.ratio:.0f} times "
            f"smaller than {by} would make it: t counts samples, not seconds"
        )
        remedy = "Give t in seconds, the number of the sample over the sampling rate in Hz"
        return [Finding(Severity.ERROR, "sample_numbers", sentence, remedy, ("t",))]
    if beat.seconds:
        return []
    sentence = (
        "t rises by exactly 1 from row to row: it is read as seconds, a log at 1 Hz; whether it counts samples "
        "instead cannot be told from the motion"
    )
    return [Finding(Severity.WARNING, "whole_seconds", sentence, "If t counts samples, give seconds", ("t",))]


class _Beat(NamedTuple):
    """What one witness says."""

    ratio: float  # of the motion in seconds to that expected
    seconds: bool | None  # False for sample numbers; None where it cannot be told


def _by_velocity(episodes: tuple[Episode, ...], vehicle: Vehicle) -> _Beat | None:
    """Compare d(position)/dt with the measured velocity; None where no velocity is measured."""
    b = blocks(episodes, vehicle)
    if np.isnan(b.velocity[:, :3]).all():
        return None
    known = np.isfinite(np.concatenate((b.velocity[:, :3], b.rate[:, :3], b.attitude), axis=-1)).all(-1)
    moved = matvec(rotations(b.attitude[known]), b.velocity[known, :3]).ravel()
    rate = b.rate[known, :3].ravel()
    if not len(moved) or np.sqrt((moved**2).mean()) < SLOWEST or not rate.any():
        return _Beat(1.0, None)
    ratio = float(moved @ rate / (moved @ moved))
    agreement = float(moved @ rate / np.sqrt((moved @ moved) * (rate @ rate)))
    if ratio < _SLOWER and agreement > _AGREES:
        return _Beat(ratio, False)
    return _Beat(ratio, True if ratio > _KEEPS_UP and agreement > _CLEARLY else None)


def _by_thrusters(episodes: tuple[Episode, ...], vehicle: Vehicle) -> _Beat:
    """Compare the motion with the push of the thrusters."""
    size, fit = _response(episodes, vehicle, 1.0)
    if size > _ENOUGH and fit > _FITS:
        return _Beat(size, True)
    if not 0 < size < _TOO_WEAK:
        return _Beat(size, None)
    faster = (_response(episodes, vehicle, interval) for interval in _INTERVALS_S)
    fits = any(better > _FITS and 1 / _NOT_FAR < then < _NOT_FAR for then, better in faster)
    return _Beat(size, False if fits else None)


def _response(episodes: tuple[Episode, ...], vehicle: Vehicle, interval: float) -> tuple[float, float]:
    """Medians over the axes of size and correlation of the response, with samples ``interval`` s apart."""
    timed = tuple(replace(episode, t=episode.t * interval) for episode in episodes)
    found = list(responses(blocks(timed, vehicle)).values())
    if not found:
        return 0.0, 0.0
    return (
        float(np.median([abs(response.slope) for response in found])),
        float(np.median([abs(response.correlation) for response in found])),
    )
