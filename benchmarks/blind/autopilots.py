"""An autopilot as owners fly it: a pilot at the sticks, roll and pitch levelled, depth and heading held by half."""

import numpy as np

from auv_torchrl.vehicle import DEGREES_OF_FREEDOM, Vehicle
from benchmarks.blind.pilots import Pilots, Signals

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
