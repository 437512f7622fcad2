"""Dives of a torpedo and trips of a ferry, of which a servo fails, steered by a helmsman, and what is diagnosed."""

import logging
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from auv_torchrl.diagnosis import Verdict, diagnose
from auv_torchrl.effects import EFFECTS
from auv_torchrl.flightlog import Episode, FlightLog
from auv_torchrl.physics import rest_state
from auv_torchrl.physics.kinematics import quaternion_from_euler, wrap_angle
from auv_torchrl.scenario import Change, Scenario
from auv_torchrl.simulator import PlainSimulator, record
from auv_torchrl.vehicle import Vehicle, load_vehicle
from benchmarks.blind.scores.table import Share

log = logging.getLogger(__name__)
VEHICLE = "remus100"
FAULTS = ("reversed", "weak", "off its middle", "stuck")
HEALTHY = "healthy"
ALL = "all faults"
ROWS = (*FAULTS, ALL, HEALTHY)
MUST = 0.9  # of the dives with a fault

DT = 0.05
AXES = ("x", "y", "z", "roll", "pitch", "yaw", "u", "v", "w", "p", "q", "r")
NOISE = np.repeat((0.002, 0.004), 3)  # m, rad
SPEED_NOISE = np.repeat((0.01, 0.005), 3)  # m/s, rad/s
HOLD_S = 8.0  # a depth, a heading and a speed

Effects = Mapping[str, Mapping[str, float]]


class Helmsman:
    """Heading by the rudders, depth by the pitch, pitch by the stern planes, all with what a person does beside."""

    def __init__(self, vehicle: Vehicle, count: int, seconds: float, rng: np.random.Generator) -> None:
        self.mixer, self.before = vehicle.mixer[:, [0, 4, 5]], None
        legs = int(seconds / HOLD_S) + 1
        self.ahead = rng.uniform(0.4, 0.7, (count, legs))
        self.depth, self.heading = rng.uniform(-1.5, 1.5, (2, count, legs))
        self.rate, self.phase = rng.uniform(0.5, 2.5, (2, count, 2, 3))  # rad/s and rad

    def __call__(self, time: float, seen: np.ndarray) -> np.ndarray:
        """Commands of the propeller and the four fins."""
        leg = int(time / HOLD_S)
        turning = np.zeros((len(seen), 3)) if self.before is None else wrap_angle(seen - self.before)[:, 3:] / DT
        self.before = seen
        pitch = np.clip(0.4 * (seen[:, 2] - self.depth[:, leg]), -0.3, 0.3)
        off = wrap_angle(self.heading[:, leg] - seen[:, 5])
        stir = 0.25 * np.sin(self.rate * time + self.phase).sum(-1)
        stern = 0.3 + 2.0 * (pitch - seen[:, 4]) - 0.4 * turning[:, 1] + stir[:, 0]
        rudder = 1.5 * off - 0.4 * turning[:, 2] + stir[:, 1]
        demand = np.clip(np.stack((self.ahead[:, leg], stern, rudder), axis=-1), -1, 1)
        return np.round(np.clip(demand @ self.mixer.T, -1, 1), 4)


class Coxswain:
    """Heading by the azimuth thrusters, at the speed of a demand, with what a person does to each actuator beside."""

    def __init__(self, vehicle: Vehicle, count: int, seconds: float, rng: np.random.Generator) -> None:
        self.mixer = vehicle.mixer[:, [0, 5]]
        self.before: np.ndarray | None = None  # what was seen a step before
        legs = int(seconds / HOLD_S) + 1
        self.ahead, self.heading = rng.uniform(0.4, 0.8, (count, legs)), rng.uniform(-1.0, 1.0, (count, legs))
        self.rate, self.phase = rng.uniform(0.3, 1.5, (2, count, vehicle.thrusters, 3))  # rad/s and rad

    def __call__(self, time: float, seen: np.ndarray) -> np.ndarray:
        """Commands of the thrusters and their servos."""
        leg = int(time / HOLD_S)
        turning = np.zeros((len(seen), 6)) if self.before is None else wrap_angle(seen - self.before) / DT
        self.before = seen
        off = wrap_angle(self.heading[:, leg] - seen[:, 5])
        demand = np.stack((self.ahead[:, leg], off - 1.5 * turning[:, 5]), axis=-1)
        stir = 0.15 * np.sin(self.rate * time + self.phase).sum(-1)
        return np.round(np.clip(np.clip(demand, -1, 1) @ self.mixer.T + stir, -1, 1), 4)


def fly_dives(vehicle: Vehicle, values: Effects, seed: int = 0, episodes: int = 3, seconds: float = 40.0) -> FlightLog:
    """Dive with ``vehicle``, changed by ``values``, from 1.5 m/s ahead; pose and velocity are logged."""
    rng = np.random.default_rng(seed)
    scenario = Scenario("flown", tuple(Change(name, EFFECTS[name], dict(given)) for name, given in values.items()))
    steps = round(seconds / DT)
    flat = np.zeros(episodes)
    level = quaternion_from_euler(flat, flat, rng.uniform(-1.0, 1.0, episodes))
    begin = np.concatenate((rng.uniform(-1, 1, (episodes, 2)), np.zeros((episodes, 1))), axis=-1)
    simulator = PlainSimulator(vehicle.expand(episodes), DT, scenario=scenario)
    simulator.resume(rest_state(begin, level, np.tile([1.5, 0, 0, 0, 0, 0], (episodes, 1)), vehicle.thrusters))
    helmsman = Helmsman if vehicle.fins else Coxswain
    pilot = helmsman(vehicle, episodes, seconds, rng)
    recorded = record(simulator, pilot, steps, DT, rng.standard_normal((steps, episodes, 6)) * NOISE)
    pose, velocity = recorded.measured, recorded.velocity + SPEED_NOISE * rng.standard_normal(recorded.velocity.shape)
    pose[..., 3:] = wrap_angle(pose[..., 3:])
    t = np.arange(steps, dtype=float) * DT
    flown = (Episode(e, t, pose[e], velocity[e], recorded.commands[e]) for e in range(episodes))
    return FlightLog("dive", tuple(flown), AXES)


def servo_kind(vehicle: Vehicle) -> str:
    """With what the names of the effects on its servos begin."""
    return "fin" if vehicle.fins else "azimuth"


def draw_fault(vehicle: Vehicle, kind: str, rng: np.random.Generator) -> tuple[int, dict[str, dict[str, float]]]:
    """A fault of one servo: its number among the thrusters, and what it does."""
    number, kind_of = int(rng.choice(vehicle.servos)) + 1, servo_kind(vehicle)
    sign = float(rng.choice([-1.0, 1.0]))
    weak, off, angle = rng.uniform(0.0, 0.5), rng.uniform(0.06, 0.15), rng.uniform(0.05, 0.15)
    values = {
        "reversed": {f"{kind_of}_gain": {f"gain_{number}": -1.0}},
        "weak": {f"{kind_of}_gain": {f"gain_{number}": weak}},
        "off its middle": {f"{kind_of}_offset": {f"offset_{number}": sign * off}},
        "stuck": {f"{kind_of}_stuck": {f"stuck_{number}": 1.0, f"angle_{number}": sign * angle}},
    }
    return number, values[kind]


class Answer(NamedTuple):
    """What the diagnosis said of one dive."""

    kind: str  # of the fault, or HEALTHY
    named: bool  # the servo and what it does, and nothing beside; of a healthy dive: no gap
    servo: bool  # that servo among others, or with another effect
    said: str


def ask(vehicle: Vehicle, kind: str, seed: int) -> Answer:
    """Fly one dive that the seed draws, and diagnose it."""
    rng = np.random.default_rng([seed, ROWS.index(kind)])
    number, values = (0, {}) if kind == HEALTHY else draw_fault(vehicle, kind, rng)
    found = diagnose(fly_dives(vehicle, values, seed=int(rng.integers(2**32))), vehicle)
    said = ", ".join(f"{effect.name} of {', '.join(map(str, effect.thrusters))}" for effect in found.effects)
    if kind == HEALTHY:
        return Answer(kind, found.verdict is Verdict.NO_GAP and not found.effects, False, said or found.verdict.value)
    kind_of = servo_kind(vehicle)
    # A servo that is stuck turns 0 times as far as it is told and stands off its middle.
    wanted = {f"{kind_of}_gain", f"{kind_of}_offset"} if kind == "stuck" else set(values)
    named = {effect.name: effect.thrusters for effect in found.effects} == dict.fromkeys(wanted, (number,))
    right = any(number in effect.thrusters and effect.name.startswith(f"{kind_of}_") for effect in found.effects)
    log.info("servo %d %s: %s%s", number, kind, said or found.verdict.value, "" if named else ", not as it was")
    return Answer(kind, named, right, said or found.verdict.value)


def report(answers: Sequence[Answer], seed: int, name: str = VEHICLE) -> list[str]:
    """A row per fault, as Markdown."""
    what = "fin" if load_vehicle(name).fins else "servo"
    lines = [f"| a {what} is | dives | named, and nothing beside | the {what} named, among others |"]
    lines += ["|---|---:|---|---|"]
    for row in ROWS:
        some = [answer for answer in answers if answer.kind == row or (row == ALL and answer.kind != HEALTHY)]
        servos = "" if row == HEALTHY else Share.of(answer.servo for answer in some).fraction
        share = Share.of(answer.named for answer in some)
        named = f"no gap: {share.fraction}" if row == HEALTHY else str(share)
        lines.append(f"| {row} | {len(some)} | {named} | {servos} |")
    return [
        *lines,
        "",
        f"Must: {MUST:.0%} named. Vehicle `{name}`, seed {seed}, three dives of 40 s in a log.",
    ]


def measure(count: int, healthy: int, seed: int, name: str = VEHICLE) -> list[str]:
    """Diagnose ``count`` dives with a fault, of each kind equally many, and healthy ones; Markdown."""
    vehicle = load_vehicle(name)
    kinds = [FAULTS[number % len(FAULTS)] for number in range(count)] + [HEALTHY] * healthy
    answers = []
    for number, kind in enumerate(kinds):
        answers.append(ask(vehicle, kind, 1000 * seed + number))
        log.info("%d of %d dives diagnosed", number + 1, len(kinds))
    return report(answers, seed, name)
