"""What is wrong with the vehicles of the sets of sensors: faults that owners report, drawn at random."""

from collections.abc import Callable
from typing import Any

import numpy as np

from auv_torchrl.effects import get_effect
from auv_torchrl.vehicle import Vehicle
from benchmarks.blind.sizes import CLEAR, Rng

Draw = Callable[[Rng, Vehicle], dict[str, Any]]
WEAK = (0.15, 0.6)  # of the thrust: weed, a broken blade, a bad phase
REVERSED = (0.8, 1.0)  # of the thrust, backwards: blades are shaped for one direction
DEPTH_BIAS = (0.3, 3.0)  # m, either way: not zeroed, or the weather since


def _gain(draw: Callable[[Rng], float]) -> Draw:
    """One thruster, any, with a gain that is drawn."""
    return lambda rng, vehicle: {f"gain_{rng.integers(1, vehicle.thrusters + 1)}": draw(rng)}


FAULTS: dict[str, tuple[str, Draw]] = {  # by name, the effect and its values
    "dead thruster": ("thruster_gain", _gain(lambda rng: 0.0)),
    "reversed thruster": ("thruster_gain", _gain(lambda rng: -float(rng.uniform(*REVERSED)))),
    "weak thruster": ("thruster_gain", _gain(lambda rng: float(rng.uniform(*WEAK)))),
    "buoyancy": ("buoyancy", lambda rng, vehicle: CLEAR["buoyancy"](rng)),
    "payload": ("payload", lambda rng, vehicle: CLEAR["payload"](rng)),
    "depth bias": (
        "depth_bias", lambda rng, vehicle: {"offset": float(rng.choice((-1, 1)) * rng.uniform(*DEPTH_BIAS))}
    ),
}  # fmt: skip
THRUSTER, LOAD, UNSEEN = ("dead thruster", "reversed thruster", "weak thruster"), ("buoyancy", "payload"), "depth bias"


def draw_fault(fault: str, vehicle: Vehicle, rng: np.random.Generator) -> dict[str, dict[str, float]]:
    """Values by effect of a fault."""
    name, draw = FAULTS[fault]
    return {name: get_effect(name).read(vehicle, draw(rng, vehicle))}
