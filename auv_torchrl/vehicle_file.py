"""A vehicle that effects have changed as the text of a vehicle file: the effects become coefficients of its own."""

from collections.abc import Mapping, Sequence
from typing import Any

import torch
import yaml
from torch import Tensor

from auv_torchrl.vehicle import Vehicle, load_vehicle
from auv_torchrl.vehicle_fields import COMMENTS

DIGITS = 8  # significant, of each number that is written
SAME = 1e-6  # relative, of what was calibrated and what the file says after rounding
_RIGID_BODY = ("mass", "inertia", "centre_of_mass", "centre_of_buoyancy", "buoyancy")
_PER_THRUSTER = ("full_thrust", "asymmetry", "exponent", "dead_band", "limit", "lag")
_WHERE_TOLD = ("reaction", "volts")  # left out where they are 0
_HULL_LATER = ("hull_height",)
_WATER_LATER = ("drag_asymmetry", "surface", "air")
_SENSORS = ("heading_bias", "pose_delay", "position_scale", "depth_scale", "depth_bias", "velocity_scale")
# left out where 0: files say what they said, and what hashes keep is found
_SENSORS_LATER = ("dvl_position", "dvl_turn", "accelerometer_position", "accelerometer_bias")
CAME_LATER = (*_HULL_LATER, *_WATER_LATER, *_SENSORS_LATER)


def fold(vehicle: Vehicle) -> Vehicle:
    """The same vehicle (empty batch) with gains in thrusts, limits and dead bands, and trim in its buoyancy.

    The water stands still, because a current is of one flight, and roll and pitch are free, because whether they are
    held is up to who flies it.

    Raises:
        ValueError: for a thruster that gives nothing, or a trim of more than its buoyancy.
    """
    dead = (vehicle.gain == 0).nonzero()[:, 0].tolist()
    if dead:
        numbers = ", ".join(str(i + 1) for i in dead)
        raise ValueError(f"thruster {numbers} gives nothing: that is a fault, and no coefficient of a sound vehicle")
    gain, buoyancy = vehicle.gain.abs(), vehicle.buoyancy - vehicle.vertical_force
    if not buoyancy > 0:
        raise ValueError(f"trim of {float(vehicle.vertical_force):.3g} N is more than the buoyancy of the vehicle")
    copy = vehicle.clone()
    for key, value in dict(
        gain=torch.ones_like(gain),
        thruster_direction=vehicle.thruster_direction * vehicle.gain.sign()[:, None],
        full_thrust=vehicle.full_thrust * gain,
        limit=vehicle.limit * gain,
        dead_band=vehicle.dead_band * gain,
        buoyancy=buoyancy,
        vertical_force=torch.zeros_like(buoyancy),
        centre_of_buoyancy=vehicle.centre_of_buoyancy * vehicle.buoyancy / buoyancy,  # it rights as before
        current=torch.zeros_like(vehicle.current),
        free=torch.ones_like(vehicle.free),
    ).items():
        copy.set(key, value)
    return copy


def entries(vehicle: Vehicle, name: str) -> dict[str, Any]:
    """What a file says of a folded vehicle, as :func:`auv_torchrl.vehicle.load_vehicle` reads it.

    Raises:
        ValueError: for a vehicle with something that no file can say.
    """
    diagonal = bool((vehicle.linear_drag == vehicle.linear_drag.diagonal().diag()).all())
    alike = {key: getattr(vehicle, key) for key in (*_PER_THRUSTER, *_told(vehicle, _WHERE_TOLD))}

    def as_they_are(*keys: str) -> dict[str, Any]:
        return {key: numbers(getattr(vehicle, key)) for key in keys}

    content = {
        "name": name,
        "rigid_body": as_they_are(*_RIGID_BODY, *_told(vehicle, _HULL_LATER)),
        **as_they_are("added_mass", "mass_scale"),
        "linear_drag": numbers(vehicle.linear_drag.diagonal() if diagonal else vehicle.linear_drag),
        **as_they_are("quadratic_drag", *_told(vehicle, _WATER_LATER), "coriolis"),
        "thrusters": {
            "position": numbers(vehicle.thruster_position),
            "direction": numbers(vehicle.thruster_direction),
            **{
                key: numbers(each.flatten()[0] if (each == each.flatten()[0]).all() else each)
                for key, each in alike.items()
            },
            **as_they_are("delay"),
        },
        **as_they_are("mixer"),
        "sensors": as_they_are(*_SENSORS, *_told(vehicle, _SENSORS_LATER)),
    }
    _refuse_what_is_lost(vehicle, content)
    return content


def _told(vehicle: Vehicle, keys: Sequence[str]) -> list[str]:
    """Those that are not all 0, which is what a file that leaves them out says."""
    return [key for key in keys if bool((getattr(vehicle, key) != 0).any())]


def described(vehicle: Vehicle) -> dict[str, Any]:
    """Every parameter as plain values, as what is kept under hashes has them."""
    return {
        name: value.tolist() for name, value in vehicle.items() if name not in CAME_LATER or bool((value != 0).any())
    }


def numbers(values: Tensor) -> Any:
    """Plain numbers, in lists as the tensor has them; whole ones as they are written by hand."""
    return _rounded(values.tolist())


def _rounded(value: Any) -> Any:
    return [_rounded(entry) for entry in value] if isinstance(value, list) else float(f"{value:.{DIGITS}g}") + 0.0


def _refuse_what_is_lost(vehicle: Vehicle, content: Mapping[str, Any]) -> None:
    read = load_vehicle(content)
    lost = [
        key
        for key, value in vehicle.items()
        if not torch.allclose(read.get(key), value, rtol=SAME, atol=SAME * max(1e-3, float(value.abs().max())))
    ]
    if lost:
        raise ValueError(f"a vehicle file cannot say {', '.join(lost)}: calibrate without effects that change it")


def section_lines(key: str, value: Any, depth: int = 0) -> list[str]:
    """An entry of a vehicle file as lines with units."""
    indent, unit = "  " * depth, f"  # {COMMENTS[key]}" if key in COMMENTS else ""
    if isinstance(value, Mapping):
        inside = [line for name, entry in value.items() for line in section_lines(name, entry, depth + 1)]
        return [f"{indent}{key}:", *inside]
    if isinstance(value, list) and any(isinstance(row, list) for row in value):
        return [f"{indent}{key}:{unit}", *(f"{indent}  - {flow(row)}" for row in value)]
    if isinstance(value, list):
        return [f"{indent}{key}: {flow(value)}{unit}"]
    shown = f"{value:.{DIGITS}g}" if isinstance(value, float) else _word(value)
    return [f"{indent}{key}: {shown}{unit}"]


def flow(row: Sequence[float]) -> str:
    """Numbers in one line."""
    return f"[{', '.join(f'{value:.{DIGITS}g}' for value in row)}]"


def _word(text: str) -> str:
    """A word as YAML has it, in quotes where it needs some."""
    return yaml.safe_dump(text, width=10_000, allow_unicode=True).splitlines()[0]
