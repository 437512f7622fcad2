"""Controllers and excitations that the diagnosis does not know: PID, sums of signals, an autopilot as owners fly it."""

import numpy as np

from auv_torchrl.vehicle import CONTROLLED_INDEX, DEGREES_OF_FREEDOM, Vehicle

CHANNELS = 4  # surge, sway, heave, yaw


class Pilots:
    """One pilot per row, drawn at random: even rows keep station, odd rows excite.

    Station keeping is a PID on the reported, noisy pose towards set points that move every few seconds, so the noise
    is in the loop. Excitation is a sum of sines, random steps and a chirp per channel, blind to the pose.
    """

    def __init__(self, vehicle: Vehicle, holding: np.ndarray, duration: float, rng: np.random.Generator) -> None:
        """Draw the pilots.

        Args:
            vehicle: the nominal vehicle, whose mixer turns demands into thruster commands.
            holding: (rows,) which rows keep station.
            duration: seconds to fly.
            rng: where the draws come from.
        """
        rows = len(holding)
        self.mixer = vehicle.mixer[:, list(CONTROLLED_INDEX)]
        self.holding = holding
        self.proportional = rng.uniform([0.8, 0.8, 0.8, 0.3], [2.0, 2.0, 2.0, 0.8], (rows, CHANNELS))
        self.integral = self.proportional * rng.uniform(0.02, 0.2, (rows, CHANNELS))
        self.derivative = self.proportional * rng.uniform(0.1, 0.4, (rows, CHANNELS))
        moves = int(duration / 5) + 2
        self.set_point_times = np.cumsum(rng.uniform(4.0, 11.0, (rows, moves)), axis=1)
        self.set_points = rng.uniform([-1, -1, -1, -np.pi], [1, 1, 1, np.pi], (moves + 1, rows, CHANNELS))
        self.sum = np.zeros((rows, CHANNELS))
        self.filtered = np.zeros((rows, CHANNELS))
        self.before: np.ndarray | None = None
        self.signals = Signals(rows, duration, rng)

    def commands(self, time: float, pose: np.ndarray, dt: float) -> np.ndarray:
        """Thruster commands (rows, n) in [-1, 1] from the reported pose (rows, 6)."""
        demand = np.where(self.holding[:, None], self.hold(time, pose, dt), self.signals.at(time))
        return np.clip(demand @ self.mixer.T, -1.0, 1.0)

    def hold(self, time: float, pose: np.ndarray, dt: float) -> np.ndarray:
        """Demands (rows, 4) that keep station: surge, sway, heave, yaw."""
        rows = np.arange(len(pose))
        target = self.set_points[(self.set_point_times < time).sum(axis=1), rows]
        here = np.column_stack((pose[:, :3], pose[:, 5]))
        moved = np.zeros_like(here) if self.before is None else _apart(here, self.before)
        self.before = here
        error = _in_body(_apart(target, here), pose[:, 5])
        self.filtered += 0.3 * (_in_body(moved / dt, pose[:, 5]) - self.filtered)
        self.sum = np.clip(self.sum + error * dt, -2.0, 2.0)
        demand = self.proportional * error + self.integral * self.sum - self.derivative * self.filtered
        return np.clip(demand, -0.8, 0.8)


def _apart(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Differences (rows, 4) of positions and headings, these the short way round."""
    difference = one - other
    difference[:, 3] = np.remainder(difference[:, 3] + np.pi, 2 * np.pi) - np.pi
    return difference


def _in_body(earth: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """Ways or rates (rows, 4) along the axes of level bodies."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    north, east, down, turn = earth.T
    return np.column_stack((cos * north + sin * east, -sin * north + cos * east, down, turn))


class Signals:
    """Sums of sines, random steps and chirps, one per row and channel."""

    def __init__(self, rows: int, duration: float, rng: np.random.Generator) -> None:
        """Draw them."""
        shape = (rows, CHANNELS, 3)
        self.sine_size = rng.uniform(0.05, 0.3, shape)
        self.sine_rate = 2 * np.pi * np.exp(rng.uniform(np.log(0.04), np.log(1.2), shape))
        self.sine_phase = rng.uniform(0, 2 * np.pi, shape)
        steps = int(duration / 0.5) + 2
        self.step_times = np.cumsum(rng.uniform(0.5, 3.0, (rows, CHANNELS, steps)), axis=2)
        self.steps = rng.uniform(-0.6, 0.6, (rows, CHANNELS, steps + 1)) * (rng.random((rows, CHANNELS, 1)) < 0.7)
        self.chirp_size = rng.uniform(0.1, 0.4, (rows, CHANNELS)) * (rng.random((rows, CHANNELS)) < 0.4)
        self.chirp_from = rng.uniform(0.03, 0.1, (rows, CHANNELS))  # Hz
        self.chirp_rate = rng.uniform(0.02, 0.08, (rows, CHANNELS))  # Hz/s
        self.chirp_period = rng.uniform(10.0, 20.0, (rows, CHANNELS))  # s, then it starts over

    def at(self, time: float) -> np.ndarray:
        """Their values (rows, 4) now."""
        sines = (self.sine_size * np.sin(self.sine_rate * time + self.sine_phase)).sum(axis=2)
        index = (self.step_times < time).sum(axis=2)[..., None]
        steps = np.take_along_axis(self.steps, index, axis=2)[..., 0]
        t = np.remainder(time, self.chirp_period)
        chirp = self.chirp_size * np.sin(2 * np.pi * (self.chirp_from + 0.5 * self.chirp_rate * t) * t)
        return sines + steps + chirp


STICKS = 0.5  # of the full command: JS_GAIN_DEFAULT of ArduSub
LEVEL = ("roll", "pitch")


class Autopilots:
    """One per row: sticks in surge, sway, heave and yaw; even rows hold depth and heading, all level the vehicle.

    Their sensors are those of the log, noise included. Gains are drawn, since owners tune them.
    """

    def __init__(self, vehicle: Vehicle, holding: np.ndarray, duration: float, rng: np.random.Generator) -> None:
        """Draw the pilots.

        Args:
            vehicle: the nominal vehicle, whose mixer turns demands into thruster commands.
            holding: (rows,) which rows hold depth and heading.
            duration: seconds to fly.
            rng: where the draws come from.
        """
        rows = len(holding)
        self.sticks, self.holding = Signals(rows, duration, rng), holding
        self.holder = Pilots(vehicle, holding, duration, rng)
        self.mixer = vehicle.mixer
        self.levels = [DEGREES_OF_FREEDOM.index(name) for name in LEVEL]
        self.proportional = rng.uniform(0.5, 1.2, (rows, 2))  # ArduSub: ATC_ANG_PIT_P 6 times ATC_RAT_PIT_P 0.135
        self.integral = self.proportional * rng.uniform(0.2, 0.6, (rows, 2))
        self.derivative = self.proportional * rng.uniform(0.1, 0.2, (rows, 2))  # 1/6 there
        self.sum, self.rate = np.zeros((rows, 2)), np.zeros((rows, 2))
        self.before: np.ndarray | None = None

    def commands(self, time: float, pose: np.ndarray, dt: float) -> np.ndarray:
        """Thruster commands (rows, n) in [-1, 1] from the reported pose (rows, 6)."""
        demand = np.zeros((len(pose), 6))
        surge, sway, heave, yaw = (STICKS * self.sticks.at(time)).T
        held = self.holder.hold(time, pose, dt)
        demand[:, 0], demand[:, 1] = surge, sway
        demand[:, 2] = np.where(self.holding, held[:, 2], heave)
        demand[:, 5] = np.where(self.holding, held[:, 3], yaw)
        demand[:, self.levels] = self._levelling(pose[:, self.levels], dt)
        return np.clip(demand @ self.mixer.T, -1.0, 1.0)

    def _levelling(self, tilt: np.ndarray, dt: float) -> np.ndarray:
        moved = np.zeros_like(tilt) if self.before is None else tilt - self.before
        self.before = tilt
        self.rate += 0.3 * (moved / dt - self.rate)
        self.sum = np.clip(self.sum + tilt * dt, -1.0, 1.0)
        demand = -(self.proportional * tilt + self.integral * self.sum + self.derivative * self.rate)
        return np.clip(demand, -STICKS, STICKS)
