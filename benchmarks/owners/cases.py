"""Which cases are flown: six families, each with an exact file, one within slack, and one that is wrong by 30 %."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import cycle

import numpy as np

from benchmarks.blind.flights.cases import SLACK, Case
from benchmarks.blind.flights.sensor_sets import sensor_set
from benchmarks.blind.flights.strangers import healthy_flights
from benchmarks.owners.still import kinds

HEALTHY = 2  # flights that go with a file that is wrong
SOUND, THRUSTER, WIRING, SENSOR, LOOSE, ELSE = "sound", "thruster", "wiring", "sensor", "comes and goes", "outside"
MEMBERS = {  # what is drawn in each family but that of sensors and the sound vehicle
    THRUSTER: ("one_way", "creeping", "stalling"),
    WIRING: ("replugged",),
    LOOSE: ("comes_and_goes",),
    ELSE: ("stuck", "sticking", "wandering"),
}
FAMILIES = (SOUND, THRUSTER, WIRING, SENSOR, LOOSE, ELSE)
FILES = ("exact", "slack", "wrong")  # the file of the vehicle


def file_of(stranger: int | None, slack: float) -> str:
    """How the file of a case differs from its vehicle."""
    if stranger is not None:
        return "wrong"
    return "slack" if slack else "exact"


def draw_owner_cases(sensors: str, cases: int, seed: int) -> list[Case]:
    """The cases and the healthy flights of those whose file is wrong, numbered from 1.

    Families and files take turns. Vehicles of which the file is wrong fly in MuJoCo, which has all effects; half of the
    others fly in the foreign simulator.
    """
    rng = np.random.default_rng([seed, 1])
    turns = cycle((family, file) for file in FILES for family in FAMILIES)
    names = {family: _in_turn(members, rng) for family, members in MEMBERS.items()}
    names[SENSOR] = _in_turn(tuple(kinds(sensors)), rng)
    common = Case(0, "", axes=sensor_set(sensors).axes, sensors=sensors)
    plants, drawn = cycle(("mujoco", "foreign")), []
    for number, (family, file) in zip(range(1, cases + 1), turns, strict=False):
        what = {} if family == SOUND else {"damage" if family == SENSOR else "outside": next(names[family])}
        if file == "wrong":
            drawn.append(replace(common, number=number, family=family, stranger=2 * number + 1, **what))
        else:
            slack = SLACK if file == "slack" else 0.0
            drawn.append(replace(common, number=number, family=family, plant=next(plants), slack=slack, **what))
    if not any(case.stranger is not None for case in drawn):
        return drawn
    sound = [replace(case, sensors=sensors, axes=common.axes) for case in healthy_flights(drawn, HEALTHY)]
    return [*drawn, *sound]


def _in_turn(names: Sequence[str], rng: np.random.Generator) -> "cycle[str]":
    """Names one after the other, from a place that is drawn."""
    first = int(rng.integers(len(names)))
    return cycle([*names[first:], *names[:first]])
