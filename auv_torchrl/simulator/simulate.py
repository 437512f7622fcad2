"""Fly recorded or planned commands: what the vehicles do, and what their sensors would report of it."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from auv_torchrl.physics import CONTROL_DT, State, rest_state
from auv_torchrl.physics.kinematics import normalise, quaternion_from_euler
from auv_torchrl.quantities import counted
from auv_torchrl.scenario import Scenario
from auv_torchrl.simulator.base import Report, Simulator
from auv_torchrl.simulator.plain import PlainSimulator
from auv_torchrl.vehicle import Vehicle

if TYPE_CHECKING:
    import torch

EVEN = 1e-6  # relative differences of sampling intervals that are rounding


class Simulated(NamedTuple):
    """States and reports of N vehicles at T + 1 times; NaN from where a vehicle has diverged."""

    states: np.ndarray  # (N, T + 1, 13) position, quaternion and body velocity that are true
    reported: Report  # (N, T + 1, ...) what the sensors say


def simulate(
    vehicles: Vehicle,
    commands: np.ndarray,
    times: np.ndarray,
    start: State | None = None,
    scenario: Scenario | None = None,
    generator: "np.random.Generator | torch.Generator | None" = None,
) -> Simulated:
    """Fly vehicles by commands alone, in the plain simulator on numpy.

    Commands that are evenly sampled, every 0.05 s or faster, are held for one step each. Others are held from the first
    of the simulator's steps of 0.05 s that begins at their time or later, and what is returned lies on straight lines
    between these steps.

    Args:
        vehicles: one (empty batch) or a batch of N; one flies under all commands.
        commands: (N, T, n) in [-1, 1]; ``commands[:, k]`` holds from ``times[k]`` to ``times[k + 1]``.
        times: (T + 1,) s, rising.
        start: states of the N vehicles at ``times[0]``, numpy; None for rest at the origin, heading north.
        scenario: effects on top of the vehicles by the time of ``start``, None for none.
        generator: of the sensors' noise; None for reports without noise.

    Raises:
        ValueError: for commands and times that do not fit.
    """
    if commands.ndim != 3 or len(times) != commands.shape[1] + 1 or not (np.diff(times) > 0).all():
        raise ValueError(
            f"simulate: commands of shape {list(commands.shape)} at {counted(len(times), 'time')}: give commands "
            "(N, T, n) and T + 1 rising times"
        )
    count, steps = commands.shape[:2]
    gaps = np.diff(times)
    even = bool(np.ptp(gaps) <= EVEN * gaps[0] and gaps[0] <= (1 + EVEN) * CONTROL_DT)
    dt = float(gaps[0]) if even else CONTROL_DT
    elapsed = times - times[0]
    if not even:
        steps = int(np.ceil(elapsed[-1] / dt))
        grid = np.arange(steps) * dt
        commands = commands[:, np.searchsorted(elapsed[:-1], grid + 1e-9, side="right") - 1]
    one = vehicles if len(vehicles.batch_size) else vehicles.expand(count)
    simulator = PlainSimulator(one, dt, scenario=scenario, generator=generator)
    simulator.resume(start or at_rest(np.zeros((count, 3)), np.zeros(count), commands.shape[-1]))
    flown = replay(simulator, commands)
    return flown if even else _between(flown, np.arange(steps + 1) * dt, elapsed)


def at_rest(position: np.ndarray, yaw: np.ndarray, thrusters: int) -> State:
    """Level vehicles that do not move, at positions (N, 3) in m and headings (N,) in rad."""
    level = np.zeros_like(yaw)
    quaternion = quaternion_from_euler(level, level, yaw)
    return rest_state(position, quaternion, np.zeros((len(position), 6)), thrusters)


def replay(simulator: Simulator, commands: np.ndarray) -> Simulated:
    """Fly commands (N, T, n), one per control step, in a simulator on numpy, from the state that it is in."""
    count, steps = commands.shape[:2]
    states, reported = np.full((2, count, steps + 1, 13), np.nan)
    lost = np.zeros(count, dtype=bool)
    for step in range(steps + 1):
        states[~lost, step] = np.concatenate(simulator.state[:3], axis=-1)[~lost]
        reported[~lost, step] = np.concatenate(simulator.report(), axis=-1)[~lost]
        if step < steps:
            lost |= simulator.step(commands[:, step])
    return Simulated(states, Report(reported[..., :3], reported[..., 3:7], reported[..., 7:]))


def _between(flown: Simulated, grid: np.ndarray, times: np.ndarray) -> Simulated:
    def at_times(series: np.ndarray) -> np.ndarray:
        columns = np.moveaxis(series, 1, -1)
        found = np.stack([np.interp(times, grid, column) for column in columns.reshape(-1, len(grid))])
        found = np.moveaxis(found.reshape(*columns.shape[:-1], len(times)), -1, 1)
        found[..., 3:7] = normalise(found[..., 3:7])
        return found

    reported = at_times(np.concatenate(flown.reported, axis=-1))
    return Simulated(at_times(flown.states), Report(reported[..., :3], reported[..., 3:7], reported[..., 7:]))
