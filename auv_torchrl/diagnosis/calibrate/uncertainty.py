"""Which coefficients of a vehicle's file are guesses, and how wide of the truth each may be, alone and together."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import SHARED_BY_THRUSTERS
from auv_torchrl.effects import get_effect
from auv_torchrl.vehicle import Vehicle, read_vehicle_file


@dataclass(frozen=True)
class Coefficient:
    """One number of the vehicle, as the parameter of the effect that changes it."""

    effect: str
    member: str
    nominal: float
    width: float  # prior standard deviation, in the parameter's unit
    low: float
    high: float
    unit: str


def as_coefficients(entries: Iterable[tuple[str, str, float, float]], vehicle: Vehicle) -> tuple[Coefficient, ...]:
    """Numbers of a vehicle, (effect, parameter, nominal, standard deviation), with the bounds and units of these."""
    found = []
    for effect, member, nominal, width in entries:
        p = get_effect(effect).member_parameters(vehicle)[member]
        found.append(Coefficient(effect, member, nominal, width, p.low, p.high, p.unit))
    return tuple(found)


def load_uncertainty(name: str | Path, vehicle: Vehicle) -> tuple[Coefficient, ...]:
    """What is uncertain in the vehicle of that name in ``conf/vehicle``, or of that YAML file."""
    return read_uncertainty(read_vehicle_file(name).get("uncertainty"), vehicle)


def read_uncertainty(content: Mapping[str, Any] | None, vehicle: Vehicle) -> tuple[Coefficient, ...]:
    """The section ``uncertainty`` of a vehicle file: ``{effect: {parameter or family: standard deviation}}``.

    Args:
        content: the section; None or empty where the coefficients are known.
        vehicle: nominal, empty batch.

    Raises:
        ValueError: for an unknown effect or parameter, one without a continuous value, or a width that is no positive
            number.
    """
    if not isinstance(content, Mapping | None):
        raise ValueError(f"uncertainty is {content!r}: give a mapping of effects to standard deviations")
    found = []
    for name, widths in (content or {}).items():
        effect = get_effect(name)
        declared, nominal = effect.member_parameters(vehicle), effect.nominal(vehicle)
        if not isinstance(widths, Mapping):
            raise ValueError(f"uncertainty: {name} is {widths!r}: give parameters with their standard deviations")
        if any(p.discrete for p in effect.parameters):
            raise ValueError(f"uncertainty: {name} is a choice, not a size: a guess of it has no standard deviation")
        known = {p.name for p in effect.parameters} | set(declared)
        if unknown := set(widths) - known:
            raise ValueError(f"uncertainty: {name} has no {sorted(unknown)}: there are {', '.join(sorted(known))}")
        for member, p in declared.items():
            width = widths.get(member, widths.get(p.name))
            if width is None:
                continue
            if isinstance(width, bool) or not isinstance(width, int | float) or not 0 < width < float("inf"):
                raise ValueError(f"uncertainty: {name}.{member} is {width!r}: give a positive number of {p.unit}")
            found.append(Coefficient(name, member, nominal[member], float(width), p.low, p.high, p.unit))
    return tuple(found)


def shared_covariance(members: Sequence[tuple[str, str]], width: Floats) -> Floats:
    """Covariance (k, k) of what a file has wrong of ``members``, (effect, parameter), each within ``width`` (k,).

    What makes all members of a family differ from flight to flight, as volts do all thrusters, is also what a file has
    wrong of all of them. Else a fit would rather bend the curve of thrust than pay once for each thruster, and go wrong
    where commands are larger than those that it has seen.
    """
    families = [_varies_with(*member) for member in members]
    same = np.array([[one is not None and one == other for other in families] for one in families])
    return np.outer(width, width) * np.where(np.eye(len(width), dtype=bool), 1.0, SHARED_BY_THRUSTERS * same)


def _varies_with(effect: str, member: str) -> tuple[str, str] | None:
    """The effect and its parameter where all members of that differ together from flight to flight."""
    for p in get_effect(effect).parameters:
        if p.varies and p.over is not None and member.startswith(f"{p.name}_"):
            return effect, p.name
    return None
