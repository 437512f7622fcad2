"""Fly dives of one vehicle, one after the other: trim, current and volts differ, and something may fade."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from auv_torchrl.effects import EFFECTS
from auv_torchrl.flightlog import POSE, Episode, FlightLog
from auv_torchrl.physics import CONTROL_DT
from auv_torchrl.physics.kinematics import wrap_angle
from auv_torchrl.simulator import PlainSimulator, at_rest, record
from auv_torchrl.vehicle import Vehicle
from benchmarks.blind.flights.pilots import Pilots

AXES = ("x", "y", "z", "yaw")
NOISE = np.repeat((0.002, 0.004), 3)  # m, rad: motion capture
SLACK = 0.03  # relative standard deviation of what the file has wrong
TURN_S, HOLDS_S = 20.0, 8.0  # of each turn the pilot keeps station for a while, then excites
TRIM_N, CURRENT, VOLTS = 0.5, 0.03, 0.01  # N, m/s and relative thrust: standard deviations from dive to dive


@dataclass(frozen=True)
class Series:
    """Dives of one vehicle to fly."""

    dives: int
    seed: int
    seconds: float = 90.0
    changes: Mapping[str, Mapping[str, np.ndarray]] = field(default_factory=dict)  # by effect and member (dives,)


def fly_series(vehicle: Vehicle, series: Series) -> list[FlightLog]:
    """The logs of all dives; roll and pitch are held, as in the paper.

    Args:
        vehicle: as its file says; that which flies has its coefficients off by a few per cent.
        series: how many, and what changes.
    """
    rng, n = np.random.default_rng(series.seed), series.dives
    level = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 1.0])
    flown = _of_the_day(vehicle.replace(free=level), rng, series)
    pilots = Pilots(vehicle, np.zeros(n, bool), series.seconds, rng)
    steps = round(series.seconds / CONTROL_DT)
    noise = NOISE * rng.standard_normal((steps, n, 6))
    simulator = PlainSimulator(flown, CONTROL_DT)
    simulator.resume(at_rest(rng.uniform(-1, 1, (n, 3)), rng.uniform(-np.pi, np.pi, n), vehicle.thrusters))

    def fly(time: float, seen: np.ndarray) -> np.ndarray:
        pilots.holding[:] = time % TURN_S < HOLDS_S
        return np.round(pilots.commands(time, seen, CONTROL_DT), 4)

    recorded = record(simulator, fly, steps, CONTROL_DT, noise)
    pose = recorded.measured.copy()
    pose[..., 3:] = wrap_angle(pose[..., 3:])
    pose[..., [axis not in AXES for axis in POSE]] = np.nan
    t, nothing = np.linspace(0.0, (steps - 1) * CONTROL_DT, steps), np.full((steps, 6), np.nan)
    return [
        FlightLog(f"dive_{i + 1:03d}", (Episode(0, t, pose[i], nothing, recorded.commands[i]),), AXES) for i in range(n)
    ]


def _of_the_day(vehicle: Vehicle, rng: np.random.Generator, series: Series) -> Vehicle:
    """The vehicle of each dive (dives,): its file a few per cent wrong, and as it differs from day to day."""
    n = series.dives
    values: dict[str, dict[str, np.ndarray]] = {
        "buoyancy": {"force": TRIM_N * rng.standard_normal(n)},
        "current": {axis: CURRENT * rng.standard_normal(n) for axis in ("north", "east")},
    }
    volts = 1 + VOLTS * rng.standard_normal(n)
    for name in ("thruster_gain", "linear_drag", "quadratic_drag", "added_mass"):
        nominal = EFFECTS[name].nominal(vehicle)
        values[name] = {m: v * (1 + SLACK * rng.standard_normal()) * np.ones(n) for m, v in nominal.items()}
    for member, gain in values["thruster_gain"].items():
        values["thruster_gain"][member] = gain * volts
    for name, members in series.changes.items():
        own = values.setdefault(name, {m: v * np.ones(n) for m, v in EFFECTS[name].nominal(vehicle).items()})
        for member, factor in members.items():
            own[member] = own[member] * factor
    fleet = vehicle.expand(n).clone()
    for name, members in values.items():
        fleet = EFFECTS[name].apply(fleet, members)
    return fleet
