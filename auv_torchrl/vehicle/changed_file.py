"""A vehicle that effects have changed as the text of a vehicle file: the effects become coefficients of its own."""

from collections.abc import Mapping, Sequence
from types import EllipsisType
from typing import Any

import numpy as np
import yaml

from auv_torchrl.vehicle import Vehicle, load_vehicle
from auv_torchrl.vehicle.fields import COMMENTS, VEHICLE_FIELDS, Field

DIGITS = 8  # significant, of each number that is written
SAME = 1e-6  # relative, of what was calibrated and what the file says after rounding


def fold(vehicle: Vehicle) -> Vehicle:
    """The same vehicle (empty batch) with gains in thrusts, limits and dead bands, and trim in its buoyancy.

    The water stands still, because a current is of one flight, and roll and pitch are free, because whether they are
    held is up to who flies it.

    Raises:
        ValueError: for a thruster that gives nothing, or a trim of more than its buoyancy.
    """
    dead = np.flatnonzero(vehicle.gain == 0).tolist()
    if dead:
        numbers = ", ".join(str(i + 1) for i in dead)
        raise ValueError(f"thruster {numbers} gives nothing: that is a fault, and no coefficient of a sound vehicle")
    gain, buoyancy = np.abs(vehicle.gain), vehicle.buoyancy - vehicle.vertical_force
    if not buoyancy > 0:
        raise ValueError(f"trim of {float(vehicle.vertical_force):.3g} N is more than the buoyancy of the vehicle")
    return vehicle.replace(
        gain=np.ones_like(gain),
        thruster_direction=vehicle.thruster_direction * np.sign(vehicle.gain)[:, None],
        full_thrust=vehicle.full_thrust * gain,
        limit=vehicle.limit * gain,
        dead_band=vehicle.dead_band * gain,
        buoyancy=buoyancy,
        vertical_force=np.zeros_like(buoyancy),
        centre_of_buoyancy=vehicle.centre_of_buoyancy * vehicle.buoyancy / buoyancy,  # it rights as before
        current=np.zeros_like(vehicle.current),
        free=np.ones_like(vehicle.free),
    )


def entries(vehicle: Vehicle, name: str) -> dict[str, Any]:
    """What a file says of a folded vehicle, as :func:`auv_torchrl.vehicle.load_vehicle` reads it.

    Raises:
        ValueError: for a vehicle with something that no file can say.
    """
    content: dict[str, Any] = {"name": name}
    for field, kind in VEHICLE_FIELDS.items():
        if kind.section is None or (kind.brief and _is_default(field, vehicle.get(field))):
            continue
        block = content.setdefault(kind.section, {}) if kind.section else content
        block[kind.entry or field] = _entry(kind, vehicle.get(field))
    _refuse_what_is_lost(vehicle, content)
    return content


def _entry(kind: Field, value: np.ndarray) -> Any:
    """Plain numbers: one for all thrusters where they are equal, the diagonal where nothing is beside it."""
    if kind.each and bool((value == value.flatten()[0]).all()):
        return numbers(value.flatten()[0])
    if kind.square and bool((value == np.diag(value.diagonal())).all()):
        return numbers(value.diagonal())
    return numbers(value)


def _is_zero(value: np.ndarray) -> bool:
    return not bool((value != 0).any())


def _is_default(name: str, value: np.ndarray) -> bool:
    default = VEHICLE_FIELDS[name].default
    return not isinstance(default, EllipsisType) and _is_zero(value - default)


def described(vehicle: Vehicle) -> dict[str, Any]:
    """Every parameter as plain values, as what is kept under hashes has them."""
    return {
        name: value.tolist()
        for name, value in vehicle.items()
        if not VEHICLE_FIELDS[name].later or not _is_default(name, value)
    }


def numbers(values: np.ndarray) -> Any:
    """Plain numbers, in lists as the array has them; whole ones as they are written by hand."""
    return _rounded(values.tolist())


def _rounded(value: Any) -> Any:
    return [_rounded(entry) for entry in value] if isinstance(value, list) else float(f"{value:.{DIGITS}g}") + 0.0


def _refuse_what_is_lost(vehicle: Vehicle, content: Mapping[str, Any]) -> None:
    read = load_vehicle(content)
    lost = [
        key
        for key, value in vehicle.items()
        if not np.allclose(read.get(key), value, rtol=SAME, atol=SAME * max(1e-3, float(np.abs(value).max())))
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
