"""Whether roll and pitch move: read off a log that measures them, else decided by the evidence of two vehicles."""

import numpy as np
import torch

from auv_torchrl.diagnosis.identify.search import Found
from auv_torchrl.diagnosis.motion.reduce import local_precision
from auv_torchrl.diagnosis.motion.smooth import noise_per_sample
from auv_torchrl.diagnosis.thresholds import SMALL_SWING
from auv_torchrl.effects.effect import changed
from auv_torchrl.flightlog import Finding, FlightLog, Severity
from auv_torchrl.vehicle import Vehicle

TILT = (3, 4)  # degrees of freedom


def hold_attitude(log: FlightLog, vehicle: Vehicle) -> Vehicle:
    """The vehicle with roll and pitch held where the log does not show them move."""
    swings = []
    for axis, column in (("roll", 3), ("pitch", 4)):
        if axis in log.axes:
            swings += [np.ptp(episode.pose[:, column]) for episode in log.episodes]
    if swings and max(swings) > SMALL_SWING:
        return vehicle
    free = torch.tensor([1.0, 1.0, 1.0, 0.0, 0.0, 1.0], dtype=vehicle.free.dtype)
    return changed(vehicle, free=vehicle.free * free)


def is_hidden(log: FlightLog, vehicle: Vehicle) -> bool:
    """Whether the vehicle may roll and pitch and the log measures neither."""
    return bool((vehicle.free[..., TILT] > 0).any()) and not {"roll", "pitch", "p", "q"} & set(log.axes)


def log_likelihood(found: Found) -> float:
    """Log evidence of the samples, the free start and the disturbance of every window integrated out.

    Unlike :attr:`Judged.evidence` it pays for the free numbers of the windows and for the sensor noise, so that
    problems with other degrees of freedom can be compared.
    """
    problem, judged = found.problem, found.best
    windows, state = problem.windows, judged.base.state
    slope = state.slope / noise_per_sample(windows, problem.sigma)[:, None]
    precision = local_precision(problem.layout, windows.dt, problem.floor)
    finite = np.isfinite(slope).all((1, 2))  # a window that diverged has paid by its chi-square
    gram = slope[finite].swapaxes(1, 2) @ slope[finite] + precision
    volumes = float((np.linalg.slogdet(gram)[1] - np.linalg.slogdet(precision)[1]).sum())
    counts = (windows.trust**2).sum((0, 1))
    noise = sum(np.log(problem.sigma[c]) * count for c, count in zip(windows.channels, counts, strict=True))
    return judged.evidence - 0.5 * volumes - float(noise)


def attitude_finding(free: bool, odds: float) -> Finding:
    """What was decided, with the log odds for it."""
    how = "free to roll and pitch" if free else "held level"
    sentence = f"roll and pitch are not measured; the log is explained better by a vehicle {how} (log odds {odds:.0f})"
    return Finding(Severity.INFO, "attitude_free" if free else "attitude_held", sentence)


def level_enough() -> Finding:
    """What is said where a level vehicle leaves nothing to explain."""
    sentence = "roll and pitch are not measured; a vehicle held level explains the log wholly, no tilt was looked for"
    return Finding(Severity.INFO, "attitude_held", sentence)
