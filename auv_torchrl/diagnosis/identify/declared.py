"""What effects declare for the vehicle of a problem, looked up once: a search asks some hundred thousand times."""

from collections.abc import Mapping
from typing import NamedTuple

from auv_torchrl.diagnosis.latest import Latest
from auv_torchrl.effects import EFFECTS, Effect
from auv_torchrl.effects.effect import Parameter
from auv_torchrl.vehicle import Vehicle


class Declared(NamedTuple):
    """Of an effect, by full name of a parameter."""

    parameters: Mapping[str, Parameter]
    nominal: dict[str, float]  # values at which it does nothing
    places: Mapping[str, int | slice]  # by the name that it was declared under, among the full names


_KNOWN: Latest[Declared] = Latest(256)  # all effects for the vehicles of some diagnoses


def declared(effect: str, vehicle: Vehicle) -> Declared:
    """The parameters of an effect for a vehicle (no batch), which nobody changes in place, and their nominal values."""
    its = EFFECTS[effect]
    return _KNOWN.of(
        lambda: Declared(its.member_parameters(vehicle), its.nominal(vehicle), _places(its, vehicle)), (its, vehicle)
    )


def _places(effect: Effect, vehicle: Vehicle) -> dict[str, int | slice]:
    places: dict[str, int | slice] = {}
    first = 0
    for p in effect.parameters:
        behind = first + len(p.members(vehicle))
        places[p.name] = first if p.over is None else slice(first, behind)
        first = behind
    return places
