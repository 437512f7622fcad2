"""Which coefficients of a vehicle's file are guesses, and how wide of the truth each may be."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

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
