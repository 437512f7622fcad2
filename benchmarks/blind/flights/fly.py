"""Fly cases in batches and hand back, apart from each other, their logs and their labels."""

import logging
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from auv_torchrl.flightlog import FlightLog
from auv_torchrl.physics import CONTROL_DT
from auv_torchrl.physics.kinematics import wrap_angle
from auv_torchrl.simulator import record
from auv_torchrl.vehicle import Vehicle
from benchmarks.blind.flights.cases import Case
from benchmarks.blind.flights.foreign import ForeignPlant
from benchmarks.blind.flights.foreign_heavy import ForeignHeavy
from benchmarks.blind.flights.influence import CLEAR_AT, influence
from benchmarks.blind.flights.logged import Flight, flight_log, measured_acceleration, measured_velocity, noise_of
from benchmarks.blind.flights.mujoco_plant import MujocoPlant, loosened
from benchmarks.blind.flights.outside import OUTSIDE, Outside
from benchmarks.blind.flights.pilots import Autopilots, Pilots
from benchmarks.blind.flights.plant import Influences, Motion, Plant, Reported, Slack
from benchmarks.blind.flights.sensor_sets import draw_fault, sensor_set
from benchmarks.blind.flights.sizes import draw_failures, draw_values
from benchmarks.blind.flights.strangers import Changes, draw_flight, draw_stranger, with_changes

ROUNDS = 12  # of drawing an effect again until it shows clearly
START = np.array([1, 1, 1, np.pi, 0.3, 0.3, 0.2, 0.5])  # m, rad, m/s, rad/s; half widths

log = logging.getLogger(__name__)


@dataclass
class Draw:
    """A case with what was drawn for it."""

    case: Case
    rng: np.random.Generator
    slack: Slack | None
    onset_s: float | None
    base: tuple[Changes, ...] = ()  # of a stranger, and of its flight: no part of what is to be found
    values: Changes = field(default_factory=dict)
    outside: Outside | None = None
    influence: dict[str, float] = field(default_factory=dict)
    damage_seed: int | None = None

    @property
    def rows(self) -> int:
        """Episodes to fly."""
        return self.case.episodes + self.case.healthy

    def label(self) -> dict[str, Any]:
        """The truth, of plain types."""
        drawn = {"values": self.values, "onset_s": self.onset_s, "influence": self.influence}
        given = {"base": list(self.base), "damage_seed": self.damage_seed}
        given |= {"drawn": self.outside.drawn()} if self.outside else {}
        return {**asdict(self.case), "truth": self.case.truth, **drawn, **given}


def fly(
    cases: list[Case], vehicle: Vehicle, seed: int, acts: Mapping[str, type[Outside]] = OUTSIDE
) -> list[tuple[FlightLog, dict[str, Any]]]:
    """Logs and labels of cases, in their order; each depends on its number and the seed alone.

    ``acts`` has what acts from outside the library, by its name.

    Raises:
        RuntimeError: if an effect does not show clearly in any of a number of draws.
    """
    draws = [_draw(case, vehicle, seed) for case in cases]
    logs: dict[int, FlightLog] = {}
    for _ in range(ROUNDS):
        waiting = [draw for draw in draws if draw.case.number not in logs]
        for draw in waiting:
            _draw_sizes(draw, vehicle, acts)
        log.info("flying %d cases", len(waiting))
        for draw, flight in zip(waiting, _fly_once(waiting, vehicle), strict=True):
            draw.influence = {} if draw.case.sensors else _influence(draw, flight, vehicle)
            if draw.case.scale != 1.0 or min(draw.influence.values(), default=np.inf) >= CLEAR_AT:
                logs[draw.case.number] = flight_log(draw.case, flight)
        if len(logs) == len(draws):
            return [(logs[draw.case.number], draw.label()) for draw in draws]
    small = {draw.case.name: draw.influence for draw in draws if draw.case.number not in logs}
    raise RuntimeError(f"blind: after {ROUNDS} draws these effects still do not show clearly: {small}")


def _draw(case: Case, vehicle: Vehicle, seed: int) -> Draw:
    rng = np.random.default_rng([seed, case.number])
    slack = Slack.draw(rng, case.slack, vehicle.thrusters) if case.slack else None
    onset_s = float(rng.uniform(0.3, 0.7) * case.episode_s) if case.onset else None
    damage_seed = int(rng.integers(2**32)) if case.damage else None
    base = () if case.stranger is None else (draw_stranger(seed, case.stranger, vehicle), draw_flight(rng))
    return Draw(case, rng, slack, onset_s, base, damage_seed=damage_seed)


def _draw_sizes(draw: Draw, vehicle: Vehicle, acts: Mapping[str, type[Outside]]) -> None:
    case = draw.case
    if case.fault:
        draw.values = draw_fault(case.fault, vehicle, draw.rng)
    elif case.failed:
        draw.values = {"thruster_gain": draw_failures(vehicle, draw.rng, case.failed)}
    else:
        draw.values = {name: draw_values(name, vehicle, draw.rng, case.scale) for name in case.effects}
    if case.outside:
        draw.outside = acts[case.outside](draw.rng, draw.rows, vehicle.thrusters, CONTROL_DT)


def _fly_once(draws: list[Draw], vehicle: Vehicle) -> list[Flight]:
    flights: dict[int, Flight] = {}
    for plant_name in _PLANTS:
        for duration in {draw.case.episode_s for draw in draws}:
            group = [d for d in draws if d.case.plant == plant_name and d.case.episode_s == duration]
            if group:
                recorded = _fly_group(group, plant_name, duration, vehicle)
                flights.update({draw.case.number: flight for draw, flight in zip(group, recorded, strict=True)})
    return [flights[draw.case.number] for draw in draws]


def _fly_group(draws: list[Draw], plant_name: str, duration: float, vehicle: Vehicle) -> list[Flight]:
    ends = np.cumsum([draw.rows for draw in draws])
    rows = [slice(int(end) - draw.rows, int(end)) for end, draw in zip(ends, draws, strict=True)]
    total, steps = int(ends[-1]), round(duration / CONTROL_DT)
    plant = _plant(plant_name, draws[0].case, vehicle, total)
    for part, draw in zip(rows, draws, strict=True):
        if draw.slack:
            plant.loosen(part, draw.slack)
        for changes in draw.base:
            _change(plant, part, changes)
        if draw.onset_s is None:
            _change(plant, part, draw.values)
    starts = [draw.rng.uniform(-1, 1, (draw.rows, 8)) * START for draw in draws]
    pilots = [
        (Autopilots if d.case.sensors else Pilots)(vehicle, np.arange(d.rows) % 2 == 0, duration, d.rng) for d in draws
    ]
    noise = [noise_of(d.case)[:6] * d.rng.standard_normal((steps, d.rows, 6)) for d in draws]
    start = np.concatenate(starts)
    plant.reset(start[:, :3], start[:, 3], start[:, 4:])

    def command(time: float, measured: np.ndarray) -> np.ndarray:
        flown = zip(rows, pilots, strict=True)
        return np.concatenate([pilot.commands(time, measured[part], CONTROL_DT) for part, pilot in flown])

    sealed = SealedPlant(plant, list(zip(rows, draws, strict=True)))
    pose, velocity, measured, sent = record(sealed, command, steps, CONTROL_DT, np.concatenate(noise, axis=1))
    measured[..., 3:] = wrap_angle(measured[..., 3:])
    return [
        Flight(
            pose[part],
            velocity[part],
            measured[part],
            measured_velocity(velocity[part], d.case, d.rng),
            sent[part],
            measured_acceleration(pose[part], velocity[part], d.case, d.rng),
        )
        for part, d in zip(rows, draws, strict=True)
    ]


class SealedPlant:
    """A plant with what happens to its vehicles on the way: effects that begin, and influences from outside."""

    def __init__(self, plant: Plant, draws: list[tuple[slice, Draw]]) -> None:
        """``draws`` are what was drawn for some rows of the plant each."""
        self._plant, self._draws, self._steps = plant, draws, 0

    @property
    def _time(self) -> float:
        return self._steps * CONTROL_DT

    def report(self) -> Reported:
        """What noiseless sensors report now, heading errors from outside included."""
        pose, velocity = self._plant.reported()
        pose = pose.copy()
        for part, draw in self._draws:
            if draw.outside:
                pose[part, 5] += draw.outside.heading_error(self._time)
        return Reported(pose, velocity)

    def step(self, commands: np.ndarray) -> None:
        """Hold what arrives of the commands for one control step."""
        time, motion = self._time, self._plant.true_motion()
        reaching, influences = commands.copy(), Influences.none(*commands.shape)
        for part, draw in self._draws:
            if draw.onset_s is not None and time - CONTROL_DT < draw.onset_s <= time:
                _change(self._plant, part, draw.values)
            if draw.outside:
                reaching[part] = draw.outside.received(commands[part])
                mine = Influences(*(field[part] for field in influences))
                draw.outside.act(time, Motion(*(field[part] for field in motion)), reaching[part], mine)
        self._plant.step(reaching, influences)
        self._steps += 1


_PLANTS = ("mujoco", "foreign")
_FOREIGN: dict[str, Callable[[int, float], Plant]] = {"paper": ForeignPlant, "bluerov2_heavy": ForeignHeavy}


def _plant(name: str, case: Case, vehicle: Vehicle, rows: int) -> Plant:
    """A simulator of the vehicle that goes with the sensors of a case."""
    if name == "mujoco":
        return MujocoPlant(vehicle, rows, CONTROL_DT)
    return _FOREIGN[sensor_set(case.sensors).vehicle](rows, CONTROL_DT)


def _change(plant: Plant, rows: slice, changes: Changes) -> None:
    for name, values in changes.items():
        plant.change(rows, name, values)


def _influence(draw: Draw, flight: Flight, vehicle: Vehicle) -> dict[str, float]:
    """How much each effect shows when all others are known."""
    base = with_changes(loosened(vehicle, draw.slack) if draw.slack else vehicle, draw.base)
    flown, found = with_changes(base, [draw.values]), {}
    for left_out in (*draw.values, *([draw.case.outside] if draw.case.outside else [])):
        known = with_changes(base, [{name: values for name, values in draw.values.items() if name != left_out}])
        found[left_out] = influence(known, flown, flight.pose, flight.velocity, flight.commands)
    return found
