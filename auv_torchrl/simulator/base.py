"""What every simulator of vehicles does: place them, step them, report what they do and what their sensors say.

Batch first, rows are vehicles; earth NED, body FRD, quaternions w x y z. A simulator knows nothing of tasks: it owns
the vehicles, their state, the memory of commands and poses, the phases of the scenario, and what counts as diverged.
"""

import math
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, NamedTuple, TypedDict

import numpy as np
from array_api_compat import array_namespace

from auv_torchrl.array_api import host
from auv_torchrl.physics import ActiveTerms, Coefficients, State, prepare, rest_state
from auv_torchrl.physics.kinematics import euler_angles
from auv_torchrl.physics.step import memory_length, push
from auv_torchrl.physics.thrusters import applied_thrust, load
from auv_torchrl.quantities import counted
from auv_torchrl.scenario import Scenario
from auv_torchrl.sensors import FELT, MOTION, SENSORS, ages, felt_along, measured_pose, measured_velocity, motion_of
from auv_torchrl.simulator.arrays import Array, Arrays, NumpyArrays, lengthened, with_rows
from auv_torchrl.vehicle import Vehicle, stacked

if TYPE_CHECKING:
    import torch

    Generator = np.random.Generator | torch.Generator

FARTHEST = 1e3  # m from the origin; a vehicle beyond it has diverged
_NEVER = math.inf, -math.inf
_ROUNDING_S = 1e-5  # of times in single precision: so close to a switching time, it is looked at exactly
FASTEST = 1e2  # m/s and rad/s; likewise


class Report(NamedTuple):
    """What the sensors of N vehicles report."""

    position: Array  # (N, 3) m
    quaternion: Array  # (N, 4)
    velocity: Array  # (N, 6) m/s and rad/s, body

    @property
    def pose(self) -> Array:
        """Position in m, then roll, pitch and yaw in rad, (N, 6)."""
        xp = array_namespace(self.position)
        return xp.concat((self.position, xp.stack(euler_angles(self.quaternion), axis=-1)), axis=-1)


class Options(TypedDict, total=False):
    """What every simulator takes by name, and hands on to :class:`Simulator`, which explains it."""

    scenario: Scenario | None
    generator: "Generator | None"
    arrays: Arrays | None


def _in_double(array: Array) -> np.ndarray:
    return np.asarray(host(array), dtype=np.float64)


def _drawn(generator: "Generator", shape: tuple[int, ...]) -> Array:
    """Standard normal numbers, of either library's generator."""
    if isinstance(generator, np.random.Generator):
        return generator.standard_normal(shape)
    import torch  # here, not above: only its own generators need it

    return torch.randn(*shape, generator=generator, dtype=torch.float64)


class Simulator(ABC):
    """N vehicles, each on its own; a subclass only moves the bodies.

    ``state`` is what they do; it may be replaced by another one, see :meth:`resume`.

    Args:
        vehicles: a batch of N, before the scenario acts.
        control_dt: s, for which each command is held.
        scenario: effects on top of each vehicle, by the time since it was placed; None for none.
        generator: of the sensors' noise; None for sensors without noise.
        arrays: the library that the state is kept in; numpy if not given.

    Raises:
        ValueError: for vehicles that are no batch of one or more.
    """

    def __init__(
        self,
        vehicles: Vehicle,
        control_dt: float,
        scenario: Scenario | None = None,
        generator: "Generator | None" = None,
        arrays: Arrays | None = None,
    ) -> None:
        if len(vehicles.batch_size) != 1 or not len(vehicles):
            raise ValueError(f"simulator: the vehicles have batch {list(vehicles.batch_size)}: give a batch [N]")
        self.count, self.thrusters = len(vehicles), vehicles.thrusters
        self.control_dt, self.generator = control_dt, generator
        self.scenario = scenario or Scenario("nominal")
        self.arrays = arrays or NumpyArrays()
        self._phase_starts = (0.0, *self.scenario.switching_times())
        self._phase = np.zeros(self.count, dtype=np.int64)
        self._scenario_delay = np.zeros(self.count)  # s
        self._steady = _NEVER  # times in s, in the middle of a step, between which nobody reaches another phase
        self._flown = vehicles.map(_in_double).clone()  # without the scenario
        first = prepare(self.scenario.vehicle_at(self._flown))
        self.coefficients = self._native(first)
        self.terms = ActiveTerms.of(first)
        zeros = self.arrays.native(np.zeros((self.count, 7)))
        self.state = rest_state(zeros[:, :3], zeros[:, 3:], zeros[:, :6], self.thrusters)
        self._before = self.state  # of the last step
        self.poses: Array = zeros[:, None]  # (N, L, 7) true poses, newest first
        self._remember(first)

    @abstractmethod
    def _advance(self, c: Coefficients, terms: ActiveTerms, command: Array) -> State:
        """The state of all vehicles after one control step from ``self.state``."""

    # vehicles

    @property
    def vehicles(self) -> Vehicle:
        """The vehicles as they are now, batch [N], effects of the scenario included."""
        phases = [self.scenario.vehicle_at(self._flown, time) for time in self._phase_starts]
        return stacked(phases)[self._phase, np.arange(self.count)]

    def replace(self, rows: Array, vehicles: Vehicle) -> None:
        """Let other vehicles fly on in some rows, from the states that these are in."""
        rows = host(rows)
        self._flown.write_rows(rows, vehicles.map(_in_double))
        for phase in np.unique(self._phase[rows]).tolist():
            self._begin_phase(rows[self._phase[rows] == phase], phase)

    def delay_scenario(self, seconds: Array) -> None:
        """Let each vehicle meet the switching times of the scenario later by ``seconds`` (N,), 0 or more.

        Raises:
            ValueError: for a wrong shape, or a time below 0 or not finite.
        """
        given = _in_double(seconds)
        if given.shape != (self.count,) or not (np.isfinite(given) & (given >= 0)).all():
            raise ValueError(f"delays of the scenario are {seconds}: give {counted(self.count, 'time')} of 0 s or more")
        self._scenario_delay = given
        self._steady = _NEVER

    def _native(self, coefficients: Coefficients) -> Coefficients:
        return Coefficients(*(self.arrays.native(field) for field in coefficients))

    def _begin_phase(self, rows: np.ndarray, phase: int) -> None:
        """Work out the coefficients of vehicles that reach a phase of the scenario."""
        new = prepare(self.scenario.vehicle_at(self._flown[rows], self._phase_starts[phase]))
        self._phase[rows], self._steady = phase, _NEVER
        self.coefficients.write_rows(self.arrays.index(rows), self._native(new))
        self.terms = self.terms | ActiveTerms.of(new)
        self._remember(new)

    def _remember(self, new: Coefficients) -> None:
        """Lengthen the memories of commands and poses if these vehicles are later than any before."""
        commands = lengthened(self.state.commands, memory_length(float(new.delay.max()), self.control_dt))
        self.state = self.state._replace(commands=commands)
        self.poses = lengthened(self.poses, memory_length(float(ages(new, MOTION).max()), self.control_dt))

    def _follow_scenario(self) -> None:
        """Change the vehicles whose time has reached a switching time."""
        xp = array_namespace(self.state.time)
        middle = self.state.time + self.control_dt / 2
        if self._steady[0] <= xp.min(middle) and xp.max(middle) < self._steady[1]:
            return
        time = _in_double(self.state.time)  # phases are counted on the host
        elapsed = time + self.control_dt / 2 - self._scenario_delay
        phase = np.searchsorted(self._phase_starts[1:], elapsed, side="right")
        changed = phase != self._phase
        for reached in np.unique(phase[changed]).tolist():
            self._begin_phase(np.flatnonzero(changed & (phase == reached)), reached)
        starts = np.array((*self._phase_starts, math.inf))
        begun, ends = starts[phase] + self._scenario_delay, starts[phase + 1] + self._scenario_delay
        self._steady = float(begun.max()) + _ROUNDING_S, float(ends.min()) - _ROUNDING_S

    # place, step, report

    def place(
        self, rows: Array, position: Array, quaternion: Array, velocity: Array, vehicles: Vehicle | None = None
    ) -> None:
        """Begin a flight of some vehicles: silent thrusters, no commands on their way, the scenario at its start.

        Args:
            rows: (n,) row numbers.
            position: (n, 3) in m.
            quaternion: (n, 4) of unit length.
            velocity: (n, 6) in m/s and rad/s, body frame.
            vehicles: a batch of n that replaces those of the rows; None leaves them.
        """
        rows = host(rows)
        if vehicles is not None:
            self._flown.write_rows(rows, vehicles.map(_in_double))
        if vehicles is not None or self._phase[rows].any():
            self._begin_phase(rows, 0)
        position, quaternion, velocity = (self.arrays.native(part) for part in (position, quaternion, velocity))
        fresh = rest_state(position, quaternion, velocity, self.thrusters, self.state.commands.shape[-2])
        index = self.arrays.index(rows)
        before = zip(self._before[:3], fresh[:3], strict=True)  # who is placed anew has not moved yet
        kept = dict(zip(State._fields, (with_rows(old, index, new) for old, new in before), strict=False))
        self.state = State(*(with_rows(old, index, new) for old, new in zip(self.state, fresh, strict=True)))
        self._before = self.state._replace(**kept)
        pose = array_namespace(position).concat((position, quaternion), axis=-1)
        self.poses = with_rows(self.poses, index, pose[:, None])

    def resume(self, state: State) -> None:
        """Go on from a state in mid-flight: commands on their way, thrusters that turn, a time of its own.

        Until now the vehicles stood where they are, as far as sensors that report late are concerned.

        Args:
            state: of all N vehicles, in the simulator's arrays.
        """
        self.state = state._replace(commands=lengthened(state.commands, self.state.commands.shape[-2]))
        self._before = self.state
        xp = array_namespace(state.position)
        pose = xp.concat((state.position, state.quaternion), axis=-1)
        self.poses = lengthened(pose[:, None], self.poses.shape[1])

    @np.errstate(over="ignore", invalid="ignore", divide="ignore")  # of vehicles that diverge: they are found below
    def step(self, command: Array, acting: Coefficients | None = None) -> Array:
        """Hold commands for one control step; which vehicles diverged in it, (N,) of bool.

        A diverged vehicle stays where it was before the step, so that everything reported stays finite.

        Args:
            command: (N, n) in [-1, 1], in the simulator's arrays.
            acting: coefficients for this step alone, e.g. with a disturbance; None for those of the vehicles.
        """
        if len(self._phase_starts) > 1:
            self._follow_scenario()
        c, terms = (self.coefficients, self.terms) if acting is None else (acting, ActiveTerms.of(acting))
        before = self._before = self.state
        self.state = self._advance(c, terms, command)
        position, _, velocity = self.state[:3]
        xp = array_namespace(position)
        lost = xp.zeros_like(position[:, 0], dtype=xp.bool)
        if not (xp.max(xp.abs(velocity)) < FASTEST and xp.max(xp.abs(position)) < FARTHEST):
            lost = ~(xp.all(xp.abs(velocity) < FASTEST, axis=-1) & xp.all(xp.abs(position) < FARTHEST, axis=-1))
            held = zip(self.state[:4], before[:4], strict=True)
            kept = (with_rows(new, lost, old[lost]) for new, old in held)
            self.state = self.state._replace(**dict(zip(State._fields, kept, strict=False)))
        pose = xp.concat(self.state[:2], axis=-1)
        self.poses = push(self.poses, pose) if self.poses.shape[1] > 1 else pose[:, None]
        return lost

    def report(self, noise: Array | None = None) -> Report:
        """What the sensors say now, late, scaled, biased and noisy as the vehicles have it.

        Args:
            noise: standard normal draws (N, 6) for this report; None lets the simulator's generator draw.
        """
        state = self.state
        if not self.terms.sensing and not SENSORS.extended:
            return Report(*state[:3])
        if noise is None and self.terms.sensor_noise and self.generator is not None:
            noise = self.arrays.native(_drawn(self.generator, (self.count, 6)))
        position, quaternion = measured_pose(
            self.coefficients, self.poses, self.control_dt, noise, load(self.coefficients, self.thrust)
        )
        return Report(position, quaternion, measured_velocity(self.coefficients, state.velocity))

    def felt(self) -> Array:
        """Specific force (N, 3) in m/s^2 that accelerometers felt on the mean over the last control step."""
        xp = array_namespace(self.state.position)
        path = [xp.concat(state[:3], axis=-1) for state in (self._before, self.state)]
        by_step = self.coefficients.rows((slice(None), None))
        return felt_along(by_step, FELT, motion_of(xp.stack(path, axis=1)), self.control_dt)[:, 0]

    @property
    def thrust(self) -> Array:
        """Thrust in N that each thruster really gives, (N, n): its gain and the battery included."""
        return applied_thrust(self.coefficients, self.terms, self.state.thrust, self.state.time)
