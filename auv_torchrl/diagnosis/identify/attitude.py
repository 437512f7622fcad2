"""Whether roll and pitch move: read off a log that measures them, else decided by the evidence of two vehicles."""

import math

import numpy as np

from auv_torchrl.diagnosis.thresholds import SMALL_SWING
from auv_torchrl.effects.effect import changed
from auv_torchrl.flightlog import Finding, FlightLog, Severity
from auv_torchrl.flightlog.log import ACCELERATION
from auv_torchrl.quantities import percent
from auv_torchrl.vehicle import Vehicle

TILT = (3, 4)  # degrees of freedom
USUALLY = 95.0  # per cent of samples: single ones are noise
_MOST_ODDS = 700.0  # log odds whose exponential is a number


def hold_attitude(log: FlightLog, vehicle: Vehicle) -> Vehicle:
    """The vehicle with roll and pitch held where the log does not show them move, and feels no weight along them."""
    if set(ACCELERATION) & set(log.axes):
        return vehicle
    swings = []
    for axis, rate, column in (("roll", "p", 3), ("pitch", "q", 4)):
        if axis in log.axes:
            swings += [np.ptp(episode.pose[:, column]) for episode in log.episodes]
        elif rate in log.axes:  # swings of a second or more
            swings += [np.nanpercentile(np.abs(episode.velocity[:, column]), USUALLY) for episode in log.episodes]
    if swings and max(swings) > SMALL_SWING:
        return vehicle
    return held_level(vehicle)


def held_level(vehicle: Vehicle) -> Vehicle:
    """The vehicle with roll and pitch held."""
    return changed(vehicle, free=vehicle.free * np.array([1.0, 1.0, 1.0, 0.0, 0.0, 1.0]))


def is_hidden(log: FlightLog, vehicle: Vehicle) -> bool:
    """Whether the vehicle may roll and pitch and the log measures neither."""
    return bool((vehicle.free[..., TILT] > 0).any()) and not {"roll", "pitch", "p", "q"} & set(log.axes)


def attitude_finding(free: bool, odds: float) -> Finding:
    """What was decided, with the probability that follows from the log odds for it."""
    how = "free to roll and pitch" if free else "held level"
    sure = percent(1.0 / (1.0 + math.exp(-min(odds, _MOST_ODDS))))
    sentence = f"roll and pitch are not measured; the log is explained better by a vehicle {how}, to {sure}"
    return Finding(Severity.INFO, "attitude_free" if free else "attitude_held", sentence)


def level_enough() -> Finding:
    """What is said where a level vehicle leaves nothing to explain."""
    sentence = "roll and pitch are not measured; a vehicle held level explains the log wholly, no tilt was looked for"
    return Finding(Severity.INFO, "attitude_held", sentence)
