"""Flights of a known vehicle, to be diagnosed: position holding and excitation, sampled with noise."""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from auv_torchrl.effects import EFFECTS
from auv_torchrl.effects.effect import changed
from auv_torchrl.flightlog import Episode, FlightLog, read_flightlog, write_flightlog
from auv_torchrl.scenario import Change, Scenario
from auv_torchrl.simulator import PlainSimulator, at_rest, record
from auv_torchrl.vehicle import Vehicle

DT = 0.05
AXES = ("x", "y", "z", "yaw")


def hold(vehicle: Vehicle) -> Vehicle:
    """The vehicle with roll and pitch held, as in the paper."""
    return changed(vehicle, free=np.array([1.0, 1.0, 1.0, 0.0, 0.0, 1.0]))


def with_slack(vehicle: Vehicle, rng: np.random.Generator, width: float = 0.03) -> Vehicle:
    """The vehicle with every coefficient off by a few percent."""

    def off(*shape: int) -> np.ndarray:
        return 1 + width * rng.standard_normal(shape)

    return changed(
        vehicle,
        gain=vehicle.gain * off(vehicle.thrusters),
        linear_drag=vehicle.linear_drag * np.diag(off(6)),
        quadratic_drag=vehicle.quadratic_drag * off(6),
        mass_scale=vehicle.mass_scale * off(6),
        dead_band=vehicle.dead_band * off(1),
    )


def fly(
    vehicle: Vehicle,
    values: dict[str, dict[str, float]],
    seed: int = 0,
    episodes: int = 6,
    seconds: float = 30.0,
    noise: tuple[float, float] = (0.002, 0.004),
    push: Callable[[np.ndarray, np.ndarray, np.ndarray, float], tuple[np.ndarray, np.ndarray]] | None = None,
    axes: tuple[str, ...] = AXES,
    onset_s: float = 0.0,
    effort: float = 1.0,
) -> FlightLog:
    """Fly ``vehicle``, changed by ``values`` from ``onset_s`` on, with so much ``effort`` of the pilot, and log it.

    ``push(commands, position, velocity, t)`` returns the commands that the thrusters get and a world force, for what
    no effect describes.
    """
    rng = np.random.default_rng(seed)
    scenario = Scenario("flown", tuple(Change(n, e, values[n], onset_s) for n, e in EFFECTS.items() if n in values))
    steps = round(seconds / DT)
    position = rng.uniform(-1, 1, (episodes, 3))
    yaw = rng.uniform(-np.pi, np.pi, episodes)
    simulator = PlainSimulator(vehicle.expand(episodes), DT, scenario=scenario)
    simulator.resume(at_rest(position, yaw, vehicle.thrusters))
    pilot = Pilot(vehicle, effort * _waves(rng, steps, episodes))
    jitter = rng.standard_normal((steps, episodes, 6)) * np.repeat(noise, 3)
    recorded = record(simulator if push is None else Pushed(simulator, push), pilot, steps, DT, jitter)
    logged, velocity, sent = recorded.measured, recorded.velocity, recorded.commands
    logged[..., 3:] = (logged[..., 3:] + np.pi) % (2 * np.pi) - np.pi
    names = ("x", "y", "z", "roll", "pitch", "yaw")
    hidden = np.array([name not in axes for name in names])
    logged[..., hidden] = np.nan
    t = np.arange(steps, dtype=float) * DT
    nothing = np.full((steps, 6), np.nan)
    rates = nothing if "u" not in axes else None
    return FlightLog(
        "flight",
        tuple(Episode(e, t, logged[e], rates if rates is not None else velocity[e], sent[e]) for e in range(episodes)),
        axes,
    )


class Pilot:
    """Holds position in every other episode and excites the others."""

    def __init__(self, vehicle: Vehicle, waves: np.ndarray) -> None:
        self.mixer, self.waves, self.before = vehicle.mixer[:, [0, 1, 2, 5]], waves, None

    def __call__(self, time: float, seen: np.ndarray) -> np.ndarray:
        """Thruster commands for what the sensors say."""
        holding = np.arange(len(seen))[:, None] % 2 == 0
        demand = np.where(holding, _hold_position(seen, self.before), self.waves[round(time / DT)])
        self.before = seen
        return np.round(np.clip(demand @ self.mixer.T, -1, 1), 4)


class Pushed:
    """A simulator whose commands and vehicles meet what no effect describes."""

    def __init__(self, simulator: PlainSimulator, push: Callable) -> None:
        self.simulator, self.push, self.report = simulator, push, simulator.report

    def step(self, command: np.ndarray) -> None:
        """Push first, then fly."""
        state = self.simulator.state
        reached, force = self.push(command, state.position, state.velocity, state.time[0])
        self.simulator.state = _pushed(state, self.simulator.coefficients, force)
        self.simulator.step(reached)


def as_read(log: FlightLog, vehicle: Vehicle) -> FlightLog:
    """A log as it is read from its file, where values that a slower sensor repeats are told."""
    with TemporaryDirectory() as folder:
        return read_flightlog(write_flightlog(log, Path(folder) / "log.csv"), vehicle)


def _hold_position(seen: np.ndarray, before: np.ndarray | None) -> np.ndarray:
    rate = np.zeros_like(seen) if before is None else (seen - before) / DT
    c, s = np.cos(seen[:, 5]), np.sin(seen[:, 5])
    pull = -0.8 * seen[:, :3] - 0.1 * np.clip(rate[:, :3], -1, 1)
    heading = -0.3 * ((seen[:, 5] + np.pi) % (2 * np.pi) - np.pi)
    return np.stack([c * pull[:, 0] + s * pull[:, 1], c * pull[:, 1] - s * pull[:, 0], pull[:, 2], heading], -1)


def _waves(rng: np.random.Generator, steps: int, episodes: int) -> np.ndarray:
    t = np.arange(steps)[:, None, None] * DT
    total = np.zeros((steps, episodes, 4))
    for _ in range(4):
        frequency, phase = rng.uniform(0.05, 0.8, (episodes, 4)), rng.uniform(0, 6.3, (episodes, 4))
        total += rng.uniform(0.05, 0.25, (episodes, 4)) * np.sin(2 * np.pi * frequency * t + phase)
    hold = rng.integers(20, 60)
    levels = rng.uniform(-0.5, 0.5, (steps // hold + 1, episodes, 4))
    return (total + np.repeat(levels, hold, axis=0)[:steps]) * np.array([1.0, 1.0, 1.0, 0.35])


def _pushed(state, c, force: np.ndarray):
    """A world force for one step, as the change of velocity that it makes."""
    from auv_torchrl.physics.kinematics import matvec, rotation_matrix

    body = matvec(rotation_matrix(state.quaternion).swapaxes(-1, -2), force)
    wrench = np.concatenate([body, np.zeros_like(body)], -1)
    return state._replace(velocity=state.velocity + DT * matvec(c.mass_inverse, wrench))
