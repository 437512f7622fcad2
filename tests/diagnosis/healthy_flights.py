"""Healthy flights of a vehicle whose file is wrong, and one flight of it that is not healthy."""

from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.identify.hypotheses import apply_values
from auv_torchrl.vehicle import load_vehicle
from tests.diagnosis.flown_logs import fly, hold

WRONG = {  # of the file, by the effects that mend it
    "thruster_gain": {f"gain_{i + 1}": gain for i, gain in enumerate((0.8, 0.85, 0.75, 0.8, 1.2, 1.2))},
    "dead_band": {"width": 6.0},
    "added_mass": {"scale_surge": 1.3, "scale_sway": 0.8, "scale_heave": 1.2, "scale_yaw": 1.25},
    "buoyancy": {"force": 1.5},
    "linear_drag": {"scale_surge": 1.4, "scale_sway": 0.8, "scale_heave": 0.7, "scale_yaw": 1.3},
    "quadratic_drag": {"scale_surge": 0.7, "scale_sway": 1.3, "scale_heave": 1.3, "scale_yaw": 0.8},
}
FILE = hold(load_vehicle("paper"))
OWN = apply_values(FILE, WRONG)
FAULT = {"thruster_gain": {"gain_3": 0.6}}


def flown(name, fault=None, seed=0, seconds=20.0):
    """A flight of 3 episodes, with a trim and a current of its own, as every flight has them."""
    rng = np.random.default_rng(seed)
    trim = {"force": float(rng.normal(0, 0.3))}
    current = {axis: float(rng.normal(0, 0.01)) for axis in ("north", "east")}
    one = apply_values(OWN, {"buoyancy": trim, "current": current})
    return replace(fly(one, fault or {}, seed=seed, episodes=3, seconds=seconds), name=name)
