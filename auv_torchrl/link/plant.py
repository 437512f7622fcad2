"""One simulated vehicle behind the link: placed at rest, stepped by commands, read as its sensors report it."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from auv_torchrl.link.protocol import Reading
from auv_torchrl.physics import CONTROL_DT, prepare
from auv_torchrl.physics.kinematics import normalise
from auv_torchrl.physics.step import memory_length
from auv_torchrl.scenario import Scenario
from auv_torchrl.sensors import MOTION, SENSORS, ages
from auv_torchrl.simulator import PlainSimulator, at_rest
from auv_torchrl.vehicle import Vehicle
from auv_torchrl.vehicle.fields import GRAVITY

LONGEST_STEP_S = CONTROL_DT  # for which the physics is stable; ArduSub, too, paces no step of 0.1 s or more


ZEROED_S = 30.0  # s at the surface, where ArduSub zeroes its depth, and has its origin once it hears its GPS
LOWERED_M_S = 0.5  # on the mean over the way down


@dataclass(frozen=True)
class Start:
    """Where the vehicle rests, level, before a flight."""

    north: float = 0.0  # m from home
    east: float = 0.0
    down: float = 0.0  # m below the surface, where home is at altitude 0
    yaw: float = 0.0  # rad
    held: bool = False  # at the surface, then let down to ``down``, and held until a thruster is driven

    @property
    def let_down_s(self) -> float:
        """When a vehicle that is held is at ``down``."""
        return ZEROED_S + abs(self.down) / LOWERED_M_S

    def held_at(self, time_s: float) -> tuple[float, float]:
        """Depth in m and sinking speed in m/s of a vehicle that is held, without jolts."""
        over = abs(self.down) / LOWERED_M_S
        share = min(max((time_s - ZEROED_S) / over, 0.0), 1.0) if over else 1.0
        speed = 0.5 * self.down * math.pi / over * math.sin(math.pi * share) if over else 0.0
        return 0.5 * self.down * (1.0 - math.cos(math.pi * share)), speed


class Moment(NamedTuple):
    """One vehicle at one time; rows of the simulator's arrays, one row each."""

    time_s: float
    state: tuple[np.ndarray, ...]  # (1, 3) position, (1, 4) quaternion, (1, 6) velocity that are true
    reported: tuple[np.ndarray, ...]  # likewise, as the sensors say
    specific_force: tuple[float, ...]  # (3,) m/s^2 on the mean over the step that ends here
    thrust: np.ndarray  # (1, n) N


class Plant:
    """A vehicle under a scenario, whose times count from where it was placed.

    Args:
        vehicle: nominal, no batch.
        scenario: effects by the time since the vehicle was placed.
        start: where it is placed.
        seed: of the sensors' noise, where the vehicle has any.
    """

    def __init__(self, vehicle: Vehicle, scenario: Scenario, start: Start, seed: int = 0):
        self.vehicle, self.scenario, self.start, self.seed = vehicle, scenario, start, seed
        self._longest_s = longest_delay(vehicle, scenario)
        self.reset()

    def reset(self) -> None:
        """Place the vehicle anew, its time at 0 and the scenario at its start."""
        noise = np.random.default_rng(self.seed)
        self.simulator = PlainSimulator(self.vehicle.expand(1), LONGEST_STEP_S, scenario=self.scenario, generator=noise)
        self._held = self.start.held
        down = self.start.held_at(0.0)[0] if self._held else self.start.down
        place = np.array([[self.start.north, self.start.east, down]])
        self.simulator.resume(at_rest(place, np.array([self.start.yaw]), self.vehicle.thrusters))
        self._past = _Past(self._longest_s, np.zeros(self.vehicle.thrusters), self._pose())
        self._last: list[float] = []  # quaternion and velocity before the step
        self.moment = self._look()

    def step(self, command: list[float], step_s: float) -> bool:
        """Hold the command (n,) for ``step_s``; whether the vehicle diverged, and stays where it was."""
        simulator = self.simulator
        if step_s != simulator.control_dt:
            self._change_step(step_s)
        row = np.array([command])
        self._held = self._held and not any(command)
        lost = self._hold() if self._held else simulator.step(row)
        if self._longest_s > 0:
            self._past.add(step_s, row[0], self._pose())
        self.moment = self._look()
        return bool(lost[0])

    def _hold(self) -> tuple[bool]:
        """Let time go by while somebody holds the vehicle; it is not lost meanwhile."""
        simulator = self.simulator
        time = simulator.state.time + simulator.control_dt
        down, sinking = self.start.held_at(float(time[0]))
        simulator.resume(
            simulator.state._replace(
                time=time,
                position=np.array([[self.start.north, self.start.east, down]]),
                velocity=np.array([[0.0, 0.0, sinking, 0.0, 0.0, 0.0]]),
            )
        )
        return (False,)

    def reading(self) -> Reading:
        """What ArduSub is told of the moment."""
        position, quaternion, velocity = (part[0].tolist() for part in self.moment.reported)
        # ArduSub makes its GPS out of it, which no compass turns: the true attitude, not the reported one
        over_ground = to_earth(self.moment.state[1][0].tolist(), velocity[:3])
        felt = self.moment.specific_force
        return Reading(self.moment.time_s, velocity[3:], felt, position, over_ground, quaternion)

    def _look(self) -> Moment:
        simulator = self.simulator
        time_s = float(simulator.state.time[0])
        return Moment(time_s, simulator.state[:3], simulator.report(), self._felt(), simulator.thrust)

    def _felt(self) -> tuple[float, ...]:
        """As ``felt`` of the simulator, in a tenth of the time where the accelerometer is that of the package."""
        simulator = self.simulator
        if SENSORS.extended:
            return tuple(simulator.felt()[0].tolist())
        after = [*simulator.state.quaternion[0].tolist(), *simulator.state.velocity[0].tolist()]
        c, before = simulator.coefficients, self._last or after
        self._last = after
        place, bias = c.accelerometer_position[0].tolist(), c.accelerometer_bias[0].tolist()
        return specific_force(before, after, simulator.control_dt, place, bias)

    def _change_step(self, step_s: float) -> None:
        """Step by another time from now on, with what was sent and where the vehicle was laid out anew by its age."""
        simulator = self.simulator
        simulator.control_dt = step_s
        c = simulator.coefficients
        sent = memory_length(float(c.delay.max()), step_s)
        seen = memory_length(float(ages(c, MOTION).max()), step_s)
        if sent > 1 or simulator.state.commands.shape[1] > 1:
            simulator.state = simulator.state._replace(commands=self._past.commands(sent, step_s))
        if seen > 1 or simulator.poses.shape[1] > 1:
            simulator.poses = self._past.poses(seen, step_s)

    def _pose(self) -> np.ndarray:
        return np.concatenate(self.simulator.state[:2], axis=-1)[0]


def longest_delay(vehicle: Vehicle, scenario: Scenario) -> float:
    """How old, in s, a command or a pose may be that still counts, at any time of the scenario."""
    phases = [prepare(scenario.vehicle_at(vehicle, time_s)) for time_s in (0.0, *scenario.switching_times())]
    return max(max(float(c.delay), float(ages(c, MOTION).max())) for c in phases)


def specific_force(
    before: Sequence[float], after: Sequence[float], step_s: float, place: Sequence[float], bias: Sequence[float]
) -> tuple[float, ...]:
    """What an accelerometer at ``place`` (3,) m feels on the mean over a step, (3,) m/s^2: the law of its instrument.

    ``before`` and ``after`` (10,) are quaternion and velocity; a test holds it to :mod:`auv_torchrl.sensors`.
    """
    x, y, z = place
    p, q, r = ((later - earlier) / step_s for earlier, later in zip(before[7:], after[7:], strict=True))
    turning = q * z - r * y, r * x - p * z, p * y - q * x
    steady = zip(_steady(before, place), _steady(after, place), strict=True)
    means = [0.5 * (earlier + later) for earlier, later in steady]
    rates = [(later - earlier) / step_s for earlier, later in zip(before[4:7], after[4:7], strict=True)]
    return tuple(map(sum, zip(means, rates, turning, bias, strict=True)))


def _steady(state: Sequence[float], place: Sequence[float]) -> tuple[float, float, float]:
    """The specific force of a motion that goes on as it is."""
    qw, qx, qy, qz, u, v, w, p, q, r = state
    x, y, z = place
    u, v, w = u + q * z - r * y, v + r * x - p * z, w + p * y - q * x
    return (
        q * w - r * v - GRAVITY * 2 * (qx * qz - qw * qy),
        r * u - p * w - GRAVITY * 2 * (qy * qz + qw * qx),
        p * v - q * u - GRAVITY * (1 - 2 * (qx * qx + qy * qy)),
    )


def to_earth(quaternion: Sequence[float], vector: Sequence[float]) -> tuple[float, float, float]:
    """A vector (3,) of the body along north, east and down: by number, 30 times as fast as by arrays of one row."""
    w, x, y, z = quaternion
    a, b, c = vector
    u, v, t = 2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)  # 2 (x, y, z) cross the vector
    return a + w * u + y * t - z * v, b + w * v + z * u - x * t, c + w * t + x * v - y * u


class _Past:
    """What was sent and where the vehicle was, with times: memories of a simulator are laid out by equal steps.

    Args:
        longest_s: how long ago anything may be asked for.
        command: (n,) before the flight.
        pose: (7,) position and quaternion likewise.
    """

    def __init__(self, longest_s: float, command: np.ndarray, pose: np.ndarray):
        self._longest_s, self._now = longest_s, 0.0
        self._kept = deque([(0.0, command, pose)])  # end of each step, the command held over it, the pose at its end

    def add(self, step_s: float, command: np.ndarray, pose: np.ndarray) -> None:
        """A step was flown."""
        self._now += step_s
        self._kept.append((self._now, command, pose))
        while len(self._kept) > 1 and self._kept[1][0] <= self._now - self._longest_s:
            self._kept.popleft()

    def commands(self, length: int, step_s: float) -> np.ndarray:
        """(1, length, n) what was held in the middle of each of the last steps, newest first, had they been these."""
        ends, commands, _ = self._series()
        middles = self._now - (np.arange(length) + 0.5) * step_s
        return commands[np.minimum(np.searchsorted(ends, middles), len(ends) - 1)][None]

    def poses(self, length: int, step_s: float) -> np.ndarray:
        """(1, length, 7) poses now, a step ago, and so on."""
        ends, _, poses = self._series()
        times = self._now - np.arange(length) * step_s
        found = np.stack([np.interp(times, ends, column) for column in poses.T], axis=-1)
        found[:, 3:] = normalise(found[:, 3:])
        return found[None]

    def _series(self) -> tuple[np.ndarray, ...]:
        return tuple(np.array(series) for series in zip(*self._kept, strict=True))
