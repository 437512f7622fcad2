"""Flight logs made with the project's physics, so that what is in them is known."""

import numpy as np

from auv_torchrl.effects import get_effect
from auv_torchrl.effects.effect import changed
from auv_torchrl.flightlog import Episode, FlightLog
from auv_torchrl.physics import CONTROL_DT
from auv_torchrl.sensors import FELT, felt_at_rows, motion_of
from auv_torchrl.simulator import PlainSimulator, at_rest, record
from auv_torchrl.vehicle import CONTROLLED_INDEX, load_vehicle, stacked

POSE_ONLY = ("x", "y", "z", "yaw")


def waves(rng: np.random.Generator, steps: int, channels: int, size: float = 0.35) -> np.ndarray:
    """Sums of three slow sines per channel, (steps, channels)."""
    t = np.arange(steps)[:, None, None] * CONTROL_DT
    period, phase = rng.uniform(2, 12, (1, channels, 3)), rng.uniform(0, 2 * np.pi, (1, channels, 3))
    return size * np.sin(2 * np.pi * t / period + phase).sum(-1)


def simulated_logs(
    name, changes, episodes=2, seconds=30.0, noise=(2e-3, 4e-3), seed=0, alike=False, felt=None, demand=None
):
    """One log per entry of ``changes`` (a list of {effect: values}), pose and velocity, flown as one batch.

    Where they are ``alike``, all have the same commands, starts and noise, however many there are. ``felt`` is the
    noise of an accelerometer in m/s^2; None for logs without one. ``demand`` (rows, steps, 6) is what is asked of the
    degrees of freedom; None for waves.
    """
    nominal = load_vehicle(name)
    rows = []
    for change in changes:
        vehicle = nominal
        for effect, values in change.items():
            vehicle = get_effect(effect).apply(vehicle, values)
        rows += [vehicle] * episodes
    vehicles = stacked([
        changed(v, position_noise=v.position_noise + noise[0], attitude_noise=v.attitude_noise + noise[1]) for v in rows
    ])  # fmt: skip
    rng = Repeated(seed, len(changes)) if alike else np.random.default_rng(seed)
    batch, steps = len(rows), round(seconds / CONTROL_DT)
    if demand is None:
        demand = np.zeros((batch, steps, 6))
        of = rng.rng if isinstance(rng, Repeated) else rng
        drawn = [waves(of, steps, 4) for _ in range(episodes if alike else batch)]
        demand[..., CONTROLLED_INDEX] = drawn * (len(changes) if alike else 1)
    commands = np.clip(demand @ nominal.mixer.T, -1, 1)
    yaw = rng.uniform(-np.pi, np.pi, batch)
    simulator = PlainSimulator(vehicles, CONTROL_DT)
    simulator.resume(at_rest(rng.normal(size=(batch, 3)), yaw, nominal.thrusters))
    noisy = Noisy(simulator, rng, noise[0])
    flown = record(noisy, lambda time, _: commands[:, round(time / CONTROL_DT)], steps, CONTROL_DT)
    t = np.arange(steps, dtype=float) * CONTROL_DT
    axes = ("x", "y", "z", "roll", "pitch", "yaw", "u", "v", "w", "p", "q", "r")
    acceleration = [None] * batch
    if felt is not None:
        by_step = simulator.coefficients.rows((slice(None), None))
        acceleration = felt_at_rows(by_step, FELT, np.stack(noisy.passed, axis=1), CONTROL_DT)
        acceleration = acceleration + felt * rng.normal(size=acceleration.shape)
        axes += FELT
    flown = [
        Episode(row % episodes, t, flown.pose[row], flown.velocity[row], commands[row], acceleration=acceleration[row])
        for row in range(batch)
    ]
    return [FlightLog(f"log {k}", tuple(flown[k * episodes : (k + 1) * episodes]), axes) for k in range(len(changes))]


class Repeated:
    """A generator that draws for the rows of one log, and has those of all the others do the same."""

    def __init__(self, seed, times):
        self.rng, self.times = np.random.default_rng(seed), times

    def normal(self, size):
        """Standard normal draws, rows first."""
        return np.tile(self.rng.normal(size=(size[0] // self.times, *size[1:])), (self.times, *[1] * (len(size) - 1)))

    def uniform(self, low, high, rows):
        """Uniform draws."""
        return np.tile(self.rng.uniform(low, high, rows // self.times), self.times)


class Noisy:
    """A simulator whose sensors take their noise from a numpy generator, velocities included."""

    def __init__(self, simulator, rng, velocity_noise):
        self.simulator, self.rng, self.velocity_noise = simulator, rng, velocity_noise
        self.step, self.passed = simulator.step, []

    def report(self):
        """Two draws: of the pose, then of the velocity."""
        shape = (self.simulator.count, 6)
        self.passed.append(motion_of(np.concatenate(self.simulator.state[:3], axis=-1)))
        report = self.simulator.report(self.rng.normal(size=shape))
        return report._replace(velocity=report.velocity + self.velocity_noise * self.rng.normal(size=shape))
