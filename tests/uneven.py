"""A vehicle whose thrusters differ from each other in everything that a vehicle file says of them."""

import copy
from typing import Any

from auv_torchrl.vehicle import Vehicle, load_vehicle, read_vehicle_file

UNEVEN = "thrusters that differ"
THRUSTERS = {
    "full_thrust": [51.5, 40.0, 60.0, 30.0, 45.0, 51.5],
    "asymmetry": [0.225, 0.0, 0.1, 0.3, 0.2, 0.225],
    "exponent": [1.5, 1.0, 1.2, 1.8, 1.5, 1.4],
    "dead_band": [0.95, 0.0, 2.0, 0.5, 1.0, 0.8],
    "limit": [51.5, 30.0, 55.0, 30.0, 40.0, 45.0],
    "lag": [0.0, 0.1, 0.05, 0.2, 0.1, 0.0],
}


def uneven_file() -> dict[str, Any]:
    """What its file would hold: a BlueROV2 with another thruster at each place."""
    content = copy.deepcopy(dict(read_vehicle_file("bluerov2")))
    content["thrusters"] |= THRUSTERS | {"reaction": [0.016, -0.016, 0.01, 0.0, 0.02, -0.016]}
    return content


def load_any(name: str) -> Vehicle:
    """The vehicle of that name, or the one whose thrusters differ."""
    return load_vehicle(uneven_file() if name == UNEVEN else name)
