"""Effects that no library entry describes: the right verdict is partly explained or unexplained."""

from typing import Any

import numpy as np
from typing_extensions import override

from benchmarks.blind.flights.plant import Influences, Motion


class Outside:
    """Base: changes commands on their way, acts during a step, or turns the reported heading; here, nothing."""

    def __init__(self, rng: np.random.Generator, rows: int, thrusters: int, dt: float) -> None:
        self.rng, self.rows, self.thrusters, self.dt = rng, rows, thrusters, dt
        self.draw()

    def draw(self) -> None:
        """Draw the size of the effect."""

    def drawn(self) -> dict[str, Any]:
        """What of it a label needs besides its name."""
        return {}

    def received(self, commands: np.ndarray) -> np.ndarray:
        """Commands (rows, n) that reach the vehicle."""
        return commands

    def act(self, time: float, motion: Motion, commands: np.ndarray, influences: Influences) -> None:
        """Change the influences of these rows in place."""

    def heading_error(self, time: float) -> float:
        """Reported yaw minus true yaw in rad."""
        return 0.0


class StickyCommands(Outside):
    """Thrusters do not follow a command that differs by less than a threshold from the one they run at."""

    @override
    def draw(self) -> None:
        self.threshold = self.rng.uniform(0.12, 0.25)
        self.held = np.zeros((self.rows, self.thrusters))

    @override
    def received(self, commands: np.ndarray) -> np.ndarray:
        self.held = np.where(np.abs(commands - self.held) > self.threshold, commands, self.held)
        return self.held


class Backlash(Outside):
    """Thrusters follow with play: the command moves them only after it has crossed a gap."""

    @override
    def draw(self) -> None:
        self.play = self.rng.uniform(0.1, 0.25)
        self.held = np.zeros((self.rows, self.thrusters))

    @override
    def received(self, commands: np.ndarray) -> np.ndarray:
        self.held = np.clip(self.held, commands - self.play, commands + self.play)
        return self.held


class AdvanceSpeed(Outside):
    """Thrust falls while the vehicle moves ahead of its thrusters (horizontal ones)."""

    @override
    def draw(self) -> None:
        self.loss = self.rng.uniform(0.8, 1.5)  # per m/s
        self.toward = np.radians([135.0, -135.0, 45.0, -45.0])

    @override
    def act(self, time: float, motion: Motion, commands: np.ndarray, influences: Influences) -> None:
        u, v = motion.velocity[:, :1], motion.velocity[:, 1:2]
        ahead = (u * np.cos(self.toward) + v * np.sin(self.toward)) * np.sign(commands[:, :4])
        influences.thrust_factor[:, :4] *= np.clip(1 - self.loss * ahead, 0.0, 2.0)


class Waves(Outside):
    """A sinusoidal force in the earth frame."""

    @override
    def draw(self) -> None:
        self.rate = 2 * np.pi / self.rng.uniform(2.5, 7.0)
        bearing = self.rng.uniform(-np.pi, np.pi)
        size = self.rng.uniform(8.0, 16.0)
        self.force = size * np.array([np.cos(bearing), np.sin(bearing), self.rng.uniform(-0.8, 0.8)])
        self.phase = self.rng.uniform(0, 2 * np.pi, (self.rows, 1))

    @override
    def act(self, time: float, motion: Motion, commands: np.ndarray, influences: Influences) -> None:
        influences.earth_force[:] += self.force * np.sin(self.rate * time + self.phase)


class WallSuction(Outside):
    """A pull towards a wall that fades within decimetres of it."""

    @override
    def draw(self) -> None:
        bearing = self.rng.uniform(-np.pi, np.pi)
        self.toward = np.array([np.cos(bearing), np.sin(bearing), 0.0])
        self.size = self.rng.uniform(14.0, 28.0)  # N at the wall
        self.place = self.rng.uniform(0.7, 1.2)  # m from the origin
        self.range = self.rng.uniform(0.3, 0.6)  # m

    @override
    def act(self, time: float, motion: Motion, commands: np.ndarray, influences: Influences) -> None:
        distance = np.maximum(self.place - motion.position @ self.toward, 0.0)
        influences.earth_force[:] += self.size * np.exp(-distance / self.range)[:, None] * self.toward


class IntermittentThruster(Outside):
    """One horizontal thruster drops out now and then."""

    @override
    def draw(self) -> None:
        self.which = self.rng.integers(4)
        self.to_off, self.to_on = 1 / self.rng.uniform(1.5, 3.0), 1 / self.rng.uniform(0.7, 1.5)  # 1/s
        self.on = np.ones(self.rows, dtype=bool)

    @override
    def act(self, time: float, motion: Motion, commands: np.ndarray, influences: Influences) -> None:
        draw = self.rng.random(self.rows)
        self.on = np.where(self.on, draw > self.to_off * self.dt, draw < self.to_on * self.dt)
        influences.thrust_factor[:, self.which] *= self.on


class WanderingGains(Outside):
    """The gains of all thrusters wander, each on its own."""

    @override
    def draw(self) -> None:
        self.spread, self.memory = self.rng.uniform(0.3, 0.5), self.rng.uniform(3.0, 8.0)
        self.gain = self.spread * self.rng.standard_normal((self.rows, self.thrusters))

    @override
    def act(self, time: float, motion: Motion, commands: np.ndarray, influences: Influences) -> None:
        keep = np.exp(-self.dt / self.memory)
        fresh = self.rng.standard_normal(self.gain.shape)
        self.gain = keep * self.gain + self.spread * np.sqrt(1 - keep**2) * fresh
        influences.thrust_factor[:] *= 1 + self.gain


class TurningCurrent(Outside):
    """A current that turns with the tide, quickly."""

    @override
    def draw(self) -> None:
        self.speed = self.rng.uniform(0.12, 0.25)
        self.rate = self.rng.choice([-1, 1]) * 2 * np.pi / self.rng.uniform(10.0, 25.0)
        self.phase = self.rng.uniform(0, 2 * np.pi, self.rows)

    @override
    def act(self, time: float, motion: Motion, commands: np.ndarray, influences: Influences) -> None:
        angle = self.rate * time + self.phase
        influences.current[:, 0] += self.speed * np.cos(angle)
        influences.current[:, 1] += self.speed * np.sin(angle)


class StuckThruster(Outside):
    """One horizontal thruster runs at a fixed command whatever is asked of it."""

    @override
    def draw(self) -> None:
        self.which = self.rng.integers(4)
        self.command = self.rng.choice([-1, 1]) * self.rng.uniform(0.25, 0.6)

    @override
    def received(self, commands: np.ndarray) -> np.ndarray:
        stuck = commands.copy()
        stuck[:, self.which] = self.command
        return stuck


class CubicDrag(Outside):
    """Drag that grows with the cube of the speed, on top of the known drag."""

    @override
    def draw(self) -> None:
        self.size = self.rng.uniform(150.0, 350.0)  # kg s/m^2

    @override
    def act(self, time: float, motion: Motion, commands: np.ndarray, influences: Influences) -> None:
        body = motion.velocity[:, :3]
        force = -self.size * (body**2).sum(axis=1, keepdims=True) * body
        cos, sin = np.cos(motion.yaw), np.sin(motion.yaw)
        influences.earth_force[:, 0] += cos * force[:, 0] - sin * force[:, 1]
        influences.earth_force[:, 1] += sin * force[:, 0] + cos * force[:, 1]
        influences.earth_force[:, 2] += force[:, 2]


class DriftingHeading(Outside):
    """A gyro that drifts: the heading error grows with time."""

    @override
    def draw(self) -> None:
        self.rate = self.rng.choice([-1, 1]) * self.rng.uniform(0.015, 0.03)  # rad/s

    @override
    def heading_error(self, time: float) -> float:
        return self.rate * time


OUTSIDE: dict[str, type[Outside]] = {
    "sticky_commands": StickyCommands,
    "backlash": Backlash,
    "advance_speed": AdvanceSpeed,
    "waves": Waves,
    "wall_suction": WallSuction,
    "intermittent_thruster": IntermittentThruster,
    "wandering_gains": WanderingGains,
    "turning_current": TurningCurrent,
    "stuck_thruster": StuckThruster,
    "cubic_drag": CubicDrag,
    "drifting_heading": DriftingHeading,
}
