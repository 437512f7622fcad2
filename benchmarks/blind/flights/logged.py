"""What of a flight comes into a log: the channels of the case, at their rates, with their noise."""

from typing import NamedTuple

import numpy as np

from auv_torchrl.flightlog import POSE, VELOCITY, Episode, FlightLog
from auv_torchrl.physics import CONTROL_DT, prepare
from auv_torchrl.sensors import FELT, felt_at_rows
from auv_torchrl.vehicle import load_vehicle
from benchmarks.blind.flights.cases import Case
from benchmarks.blind.flights.sensor_sets import LEFT_OFF, sensor_set


class Flight(NamedTuple):
    """What was recorded of one case; (episodes, T, ...)."""

    pose: np.ndarray  # as reported, noiseless
    velocity: np.ndarray  # of the body, noiseless
    measured: np.ndarray  # pose as logged
    measured_velocity: np.ndarray  # as logged
    commands: np.ndarray  # as sent
    acceleration: np.ndarray | None = None  # (episodes, T, 3) as logged


def noise_of(case: Case) -> np.ndarray:
    """Standard deviation (12,) of the noise of each number of a motion."""
    return case.noise * np.array(sensor_set(case.sensors).noise)


def measured_velocity(velocity: np.ndarray, case: Case, rng: np.random.Generator) -> np.ndarray:
    """Body velocity (episodes, T, 6) with noise; NaN where the log holds none."""
    if not set(VELOCITY) & set(case.axes):
        return np.full_like(velocity, np.nan)
    return velocity + noise_of(case)[6:] * rng.standard_normal(velocity.shape)


def measured_acceleration(
    pose: np.ndarray, velocity: np.ndarray, case: Case, rng: np.random.Generator
) -> np.ndarray | None:
    """Specific force (episodes, T, 3) with noise and what a calibration leaves; None where the log holds none.

    Of the pose (episodes, T, 6) and the body velocity as they are, over the time around each row.
    """
    if not set(FELT) & set(case.axes):
        return None
    felt = felt_at_rows(
        prepare(load_vehicle("paper")).numpy(), FELT, np.concatenate([pose, velocity], axis=-1), CONTROL_DT
    )
    noise = case.noise * np.array([sensor_set(case.sensors).channels[axis].noise for axis in FELT])
    return felt + rng.uniform(-LEFT_OFF, LEFT_OFF, 3) + noise * rng.standard_normal(felt.shape)


def flight_log(case: Case, flight: Flight) -> FlightLog:
    """All episodes that were flown, those of the healthy log last."""
    episodes = []
    for number, commands in enumerate(flight.commands):
        pose = _logged(case, POSE, flight.measured[number])
        velocity = _logged(case, VELOCITY, flight.measured_velocity[number])
        t = np.arange(len(pose), dtype=np.float64) * CONTROL_DT
        felt = None if flight.acceleration is None else flight.acceleration[number]
        episodes.append(Episode(number, t, pose, velocity, commands, acceleration=felt))
    return FlightLog(case.name, tuple(episodes), case.axes)


def _logged(case: Case, axes: tuple[str, ...], measured: np.ndarray) -> np.ndarray:
    """Columns (T, 6) as they come into the log: NaN where they are not in it, held from one measurement to the next."""
    columns = np.full_like(measured, np.nan)
    for i, axis in enumerate(axes):
        if axis in case.axes:
            every = sensor_set(case.sensors).channels[axis].every
            columns[:, i] = np.repeat(measured[::every, i], every)[: len(measured)]
    return columns
