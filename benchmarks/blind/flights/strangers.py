"""Vehicles that nobody has measured: their file is wrong about most of what they are, and healthy flights are given.

One stranger differs from its file in every coefficient, and stays as it is over all of its flights; trim and current
differ from one flight to the next.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from auv_torchrl.effects import get_effect
from auv_torchrl.effects.flow import COUPLINGS
from auv_torchrl.vehicle import CONTROLLED, Vehicle
from benchmarks.blind.flights.cases import HEALTHY, Case, count_by_family, draw_cases

FAMILIES = ("single", "pair", "no_gap", "outside")
HEALTHY_EPISODES = 4  # of 30 s
CASES_PER_STRANGER = 7  # so that 40 cases are flown with 6 vehicles
OFF = 0.3  # standard deviation of the logarithm of a coefficient over that of the file
GAINS_APART = 0.1  # the same, of a thruster against the others
EXPONENT, ASYMMETRY = (1.0, 1.6), (0.0, 0.25)  # of the thrust curve: linear to nearly that of a propeller
COUPLING = {(False, False): 5.0, (False, True): 1.5, (True, False): 0.5}  # standard deviation; of yaw, by yaw
TRIM, OFFSET = 2.0, 0.005  # N, m; standard deviations
TRIM_BETWEEN, CURRENT_BETWEEN = 0.5, 0.02  # N, m/s; the same, from flight to flight

Changes = dict[str, dict[str, float]]  # values by effect


def draw_stranger(seed: int, number: int, vehicle: Vehicle) -> Changes:
    """In what one stranger differs from the file of ``vehicle``; the same for the same seed and number."""
    rng = np.random.default_rng([seed, 0, number])

    def factor(size: float = OFF) -> float:
        return float(np.exp(size * rng.standard_normal()))

    common = factor()
    changes = {"thruster_gain": {f"gain_{i + 1}": common * factor(GAINS_APART) for i in range(vehicle.thrusters)}}
    for effect in ("linear_drag", "quadratic_drag", "added_mass"):
        changes[effect] = {f"scale_{axis}": factor() for axis in CONTROLLED}
    changes["dead_band"] = {"width": get_effect("dead_band").nominal(vehicle)["width"] * factor()}
    changes["thrust_curve"] = {
        "exponent": float(rng.uniform(*EXPONENT)),
        "asymmetry": float(rng.uniform(*ASYMMETRY)),
    }
    changes["drag_coupling"] = {f"drag_{name}": float(rng.normal(0, _coupling(name))) for name in COUPLINGS}
    changes["buoyancy"] = {"force": float(rng.normal(0, TRIM))}
    changes["mass_offset"] = {"x": float(rng.normal(0, OFFSET)), "y": float(rng.normal(0, OFFSET))}
    return changes


def draw_flight(rng: np.random.Generator) -> Changes:
    """In what a flight differs from other flights of the same vehicle."""
    return {
        "buoyancy": {"force": float(rng.normal(0, TRIM_BETWEEN))},
        "current": {axis: float(rng.normal(0, CURRENT_BETWEEN)) for axis in ("north", "east")},
    }


def draw_stranger_cases(cases: int, shares: Mapping[str, float], seed: int) -> list[Case]:
    """The cases, numbered from 1, families mixed, strangers in turn; half of the strangers in each simulator.

    Raises:
        ValueError: for a family that strangers are not flown in.
    """
    count_by_family(cases, shares, FAMILIES)
    strangers = max(1, round(cases / CASES_PER_STRANGER))
    drawn = []
    for i, case in enumerate(draw_cases(cases, shares, seed)):
        number = i % strangers + 1
        drawn.append(replace(case, stranger=number, plant=_plant(number), slack=0.0))
    return drawn


def healthy_flights(cases: Iterable[Case], flights: int) -> list[Case]:
    """``flights`` healthy flights of each stranger that is met in ``cases``, numbered on from them."""
    cases = list(cases)
    last = max(case.number for case in cases)
    met = sorted({case.stranger for case in cases if case.stranger is not None})
    owners = [number for number in met for _ in range(flights)]
    return [
        Case(last + i + 1, HEALTHY, plant=_plant(number), episodes=HEALTHY_EPISODES, stranger=number)
        for i, number in enumerate(owners)
    ]


def with_changes(vehicle: Vehicle, changes: Iterable[Changes]) -> Vehicle:
    """The vehicle with changes one after the other."""
    for one in changes:
        for name, values in one.items():
            vehicle = get_effect(name).apply(vehicle, values)
    return vehicle


def as_flown(label: Mapping[str, Any]) -> Changes:
    """The values by effect that the log of a label has: a current adds to that of its flight, and no log parts them."""
    own: Changes = {}
    for flight in label.get("base", ())[1:]:
        own.update(flight)
    return {
        name: {key: value + own.get(name, {}).get(key, 0.0) for key, value in values.items()}
        for name, values in label["values"].items()
    }


def _plant(number: int) -> str:
    return "mujoco" if number % 2 else "foreign"


def _coupling(name: str) -> float:
    """Standard deviation in kg/s, or kg m/s where one of both is a rotation."""
    to, by = name.split("_from_")
    return COUPLING[to == "yaw", by == "yaw"]
