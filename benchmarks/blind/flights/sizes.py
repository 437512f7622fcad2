"""How large each effect of the library is drawn: from a clear size down to the detection limit."""

from collections.abc import Callable
from typing import Any

import numpy as np

from auv_torchrl.effects import get_effect
from auv_torchrl.effects.flow import COUPLINGS
from auv_torchrl.vehicle import CONTROLLED, Vehicle

Rng = np.random.Generator
Draw = Callable[[Rng], dict[str, Any]]
HORIZONTAL = (1, 2, 3, 4)  # thrusters of the vehicle `paper`
NOT_A_GAP = ("sensor_noise", "depth_bias")  # change what is measured, not where the simulator goes wrong
NOT_TELLABLE = ("depth_scale",)  # a log of poses shows it as vertical thrust; the family of damaged logs flies z up
# The vehicle of these logs turns little by its propellers, its heading comes from cameras, it is a box,
# it stays in deep water, and its speed controllers turn both ways and rest at neutral.
NOT_MET = (
    "reaction_torque", "compass_interference", "drag_asymmetry", "free_surface", "forward_gain", "reverse_gain",
    "neutral_offset",
)  # fmt: skip
NOT_LOGGED = (  # of what only damage or a set of sensors logs
    "velocity_scale", "gyro_bias", "accelerometer_bias", "dvl_misalignment", "dvl_lever_arm",
)  # fmt: skip
COEFFICIENTS = ("hull", "thruster_place")  # fitted by calibration; of drag and inertia the scales below stand for them


def _sign(rng: Rng) -> float:
    return float(rng.choice((-1.0, 1.0)))


def _faulty_gain(rng: Rng) -> float:
    return -rng.uniform(0.5, 1.0) if rng.random() < 0.25 else rng.uniform(0.0, 0.75)


def _gain(rng: Rng) -> dict[str, Any]:
    value = _faulty_gain(rng)
    return {f"gain_{rng.integers(1, 7)}": value}


def _swap(rng: Rng) -> dict[str, Any]:
    return {"pair": [int(i) for i in rng.choice(HORIZONTAL, 2, replace=False)]}


def _limit(rng: Rng) -> dict[str, Any]:
    key = "limit" if rng.random() < 0.5 else f"limit_{rng.choice(HORIZONTAL)}"
    return {key: rng.uniform(15.0, 35.0)}


def _curve(rng: Rng) -> dict[str, Any]:
    kind = rng.integers(3)
    values = {"exponent": rng.uniform(1.3, 2.0)} if kind != 1 else {}
    return values | ({"asymmetry": rng.uniform(0.2, 0.4)} if kind != 0 else {})


def _drag_scale(rng: Rng) -> dict[str, Any]:
    return {f"scale_{rng.choice(CONTROLLED)}": 0.5 if rng.random() < 0.25 else rng.uniform(1.5, 2.5)}


def _coupling(rng: Rng) -> dict[str, Any]:
    name = str(rng.choice(COUPLINGS))
    to, by = name.split("_from_")
    low, high = {(False, False): (15.0, 50.0), (False, True): (4.0, 12.0), (True, False): (1.0, 5.0)}[
        to == "yaw", by == "yaw"
    ]  # kg/s, kg m/s (force from yaw rate), kg m/s (moment from speed)
    return {f"drag_{name}": _sign(rng) * rng.uniform(low, high)}


def _payload(rng: Rng) -> dict[str, Any]:
    place = rng.uniform(-0.1, 0.1, 2) if rng.random() < 0.5 else np.zeros(2)
    return {"mass": rng.uniform(2, 6), "weight": rng.uniform(3, 10), "x": place[0], "y": place[1]}


def _direction(rng: Rng, size: float) -> tuple[float, float]:
    angle = rng.uniform(-np.pi, np.pi)
    return size * np.cos(angle), size * np.sin(angle)


def _mass_offset(rng: Rng) -> dict[str, Any]:
    return dict(zip(("x", "y"), _direction(rng, rng.uniform(0.03, 0.08)), strict=True))


def _current(rng: Rng) -> dict[str, Any]:
    return dict(zip(("north", "east"), _direction(rng, rng.uniform(0.08, 0.25)), strict=True))


def _tether(rng: Rng) -> dict[str, Any]:
    distance = rng.uniform(2.5, 8.0)
    north, east = _direction(rng, distance)
    down = -rng.uniform(0.0, 2.0)
    slack = np.hypot(distance, down) - rng.uniform(0.5, 1.5)
    return {"north": north, "east": east, "down": down, "stiffness": rng.uniform(5.0, 15.0), "slack": slack}


def _scale(rng: Rng) -> dict[str, Any]:
    return {"factor": rng.uniform(0.7, 0.85) if rng.random() < 0.5 else rng.uniform(1.2, 1.4)}


CLEAR: dict[str, Draw] = {
    "thruster_gain": _gain,
    "thruster_swap": _swap,
    "thruster_misalignment": lambda rng: {f"angle_{rng.choice(HORIZONTAL)}": _sign(rng) * rng.uniform(0.2, 0.6)},
    "thrust_limit": _limit,
    "dead_band": lambda rng: {"width": rng.uniform(8.0, 14.0)},
    "thrust_curve": _curve,
    "thruster_lag": lambda rng: {"time_constant": rng.uniform(0.1, 0.3)},
    "command_delay": lambda rng: {"delay": rng.uniform(0.1, 0.3)},
    "battery_sag": lambda rng: {"rate": rng.uniform(0.2, 0.5)},
    "added_mass": lambda rng: {f"scale_{rng.choice(CONTROLLED)}": rng.uniform(1.4, 2.5)},
    "payload": _payload,
    "buoyancy": lambda rng: {"force": _sign(rng) * rng.uniform(3.0, 12.0)},
    "mass_offset": _mass_offset,
    "linear_drag": _drag_scale,
    "quadratic_drag": _drag_scale,
    "drag_coupling": _coupling,
    "coriolis": lambda rng: {"strength": 1.0},
    "current": _current,
    "tether": _tether,
    "heading_bias": lambda rng: {"angle": _sign(rng) * rng.uniform(0.1, 0.3)},
    "pose_delay": lambda rng: {"delay": rng.uniform(0.1, 0.3)},
    "position_scale": _scale,
}
_KEPT_WHOLE = {"tether": ("north", "east", "down", "slack"), "payload": ("x", "y", "z")}  # places, not sizes


def draw_values(name: str, vehicle: Vehicle, rng: Rng, scale: float = 1.0) -> dict[str, float]:
    """Values of a clear size, or ``scale`` times the way from the nominal value to it.

    Raises:
        ValueError: for a swap at a scale other than 1, which does not exist.
    """
    effect = get_effect(name)
    values = effect.read(vehicle, CLEAR[name](rng))
    if scale == 1.0:
        return values
    nominal = effect.nominal(vehicle)
    if any(p.discrete for p in effect.parameters):
        raise ValueError(f"{name} has no smaller size than a whole one")
    kept = _KEPT_WHOLE.get(name, ())
    return {
        key: value if key in kept else nominal[key] + scale * (value - nominal[key]) for key, value in values.items()
    }


def draw_failures(vehicle: Vehicle, rng: Rng, failed: int) -> dict[str, float]:
    """Gains of several horizontal thrusters that failed each in its own way; the vertical ones share a command."""
    faulty = rng.choice(HORIZONTAL, failed, replace=False)
    return get_effect("thruster_gain").read(vehicle, {f"gain_{i}": _faulty_gain(rng) for i in faulty})
