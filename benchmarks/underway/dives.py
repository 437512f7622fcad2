"""Dives of a torpedo of which a fin fails, steered by a helmsman, and what the diagnosis names."""

import logging
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from auv_torchrl.diagnosis import Verdict, diagnose
from auv_torchrl.effects import EFFECTS
from auv_torchrl.flightlog import Episode, FlightLog
from auv_torchrl.physics import rest_state
from auv_torchrl.physics.kinematics import quaternion_from_euler, wrap_angle
from auv_torchrl.scenario import Change, Scenario
from auv_torchrl.simulator import PlainSimulator, record
from auv_torchrl.vehicle import Vehicle, load_vehicle
from benchmarks.blind.statistics import Share

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
        self.before: Any = seen
        pitch = np.clip(0.4 * (seen[:, 2] - self.depth[:, leg]), -0.3, 0.3)
        off = wrap_angle(self.heading[:, leg] - seen[:, 5])
        stir = 0.25 * np.sin(self.rate * time + self.phase).sum(-1)
        stern = 0.3 + 2.0 * (pitch - seen[:, 4]) - 0.4 * turning[:, 1] + stir[:, 0]
        rudder = 1.5 * off - 0.4 * turning[:, 2] + stir[:, 1]
        demand = np.clip(np.stack((self.ahead[:, leg], stern, rudder), axis=-1), -1, 1)
        return np.round(np.clip(demand @ self.mixer.T, -1, 1), 4)


def fly_torpedo(
    vehicle: Vehicle, values: Effects, seed: int = 0, episodes: int = 3, seconds: float = 40.0
) -> FlightLog:
    """Dive with ``vehicle``, changed by ``values``, from 1.5 m/s ahead; pose and velocity are logged."""
    rng = np.random.default_rng(seed)
    scenario = Scenario("flown", tuple(Change(name, EFFECTS[name], dict(given)) for name, given in values.items()))
    steps = round(seconds / DT)
    flat = np.zeros(episodes)
    level = quaternion_from_euler(flat, flat, rng.uniform(-1.0, 1.0, episodes))
    begin = np.concatenate((rng.uniform(-1, 1, (episodes, 2)), np.zeros((episodes, 1))), axis=-1)
    simulator = PlainSimulator(vehicle.expand(episodes), DT, scenario=scenario)
    simulator.resume(rest_state(begin, level, np.tile([1.5, 0, 0, 0, 0, 0], (episodes, 1)), vehicle.thrusters))
    pilot = Helmsman(vehicle, episodes, seconds, rng)
    recorded = record(simulator, pilot, steps, DT, rng.standard_normal((steps, episodes, 6)) * NOISE)
    pose, velocity = recorded.measured, recorded.velocity + SPEED_NOISE * rng.standard_normal(recorded.velocity.shape)
    pose[..., 3:] = wrap_angle(pose[..., 3:])
    t = np.arange(steps, dtype=float) * DT
    flown = (Episode(e, t, pose[e], velocity[e], recorded.commands[e]) for e in range(episodes))
    return FlightLog("dive", tuple(flown), AXES)


def draw_fault(vehicle: Vehicle, kind: str, rng: np.random.Generator) -> tuple[int, dict[str, dict[str, float]]]:
    """A fault of one fin: the number of the fin among the thrusters, and what it does."""
    fin = int(rng.choice(vehicle.fins)) + 1
    sign = float(rng.choice([-1.0, 1.0]))
    weak, off, angle = rng.uniform(0.0, 0.5), rng.uniform(0.06, 0.15), rng.uniform(0.05, 0.15)
    values = {
        "reversed": {"fin_gain": {f"gain_{fin}": -1.0}},
        "weak": {"fin_gain": {f"gain_{fin}": weak}},
        "off its middle": {"fin_offset": {f"offset_{fin}": sign * off}},
        "stuck": {"fin_stuck": {f"stuck_{fin}": 1.0, f"angle_{fin}": sign * angle}},
    }
    return fin, values[kind]


class Answer(NamedTuple):
    """What the diagnosis said of one dive."""

    kind: str  # of the fault, or HEALTHY
    named: bool  # the fin and what it does, and nothing beside; of a healthy dive: no gap
    fin: bool  # that fin among others, or with another effect
    said: str


def ask(vehicle: Vehicle, kind: str, seed: int) -> Answer:
    """Fly one dive that the seed draws, and diagnose it."""
    rng = np.random.default_rng([seed, ROWS.index(kind)])
    fin, values = (0, {}) if kind == HEALTHY else draw_fault(vehicle, kind, rng)
    found = diagnose(fly_torpedo(vehicle, values, seed=int(rng.integers(2**32))), vehicle)
    said = ", ".join(f"{effect.name} of {', '.join(map(str, effect.thrusters))}" for effect in found.effects)
    if kind == HEALTHY:
        return Answer(kind, found.verdict is Verdict.NO_GAP and not found.effects, False, said or found.verdict.value)
    # A fin that is stuck turns 0 times as far as it is told and stands off its middle.
    wanted = {"fin_gain", "fin_offset"} if kind == "stuck" else set(values)
    named = {effect.name: effect.thrusters for effect in found.effects} == dict.fromkeys(wanted, (fin,))
    right = any(fin in effect.thrusters and effect.name.startswith("fin_") for effect in found.effects)
    log.info("fin %d %s: %s%s", fin, kind, said or found.verdict.value, "" if named else ", not as it was")
    return Answer(kind, named, right, said or found.verdict.value)


def report(answers: Sequence[Answer], seed: int) -> list[str]:
    """A row per fault, as Markdown."""
    lines = ["| a fin is | dives | named, and nothing beside | the fin named, among others |", "|---|---:|---|---|"]
    for row in ROWS:
        some = [answer for answer in answers if answer.kind == row or (row == ALL and answer.kind != HEALTHY)]
        fins = "" if row == HEALTHY else Share.of(answer.fin for answer in some).fraction
        share = Share.of(answer.named for answer in some)
        named = f"no gap: {share.fraction}" if row == HEALTHY else str(share)
        lines.append(f"| {row} | {len(some)} | {named} | {fins} |")
    return [
        *lines,
        "",
        f"Must: {MUST:.0%} named. Vehicle `{VEHICLE}`, seed {seed}, three dives of 40 s in a log.",
    ]


def measure(count: int, healthy: int, seed: int) -> list[str]:
    """Diagnose ``count`` dives with a fault, of each kind equally many, and healthy ones; Markdown."""
    vehicle = load_vehicle(VEHICLE)
    kinds = [FAULTS[number % len(FAULTS)] for number in range(count)] + [HEALTHY] * healthy
    answers = []
    for number, kind in enumerate(kinds):
        answers.append(ask(vehicle, kind, 1000 * seed + number))
        log.info("%d of %d dives diagnosed", number + 1, len(kinds))
    return report(answers, seed)
