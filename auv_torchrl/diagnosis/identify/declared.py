"""What effects declare for the vehicle of a problem, looked up once: a search asks some hundred thousand times."""

from collections.abc import Mapping
from typing import NamedTuple

from auv_torchrl.effects import EFFECTS, Effect
from auv_torchrl.effects.effect import Parameter
from auv_torchrl.vehicle import Vehicle

KEPT = 256  # entries: all effects for the vehicles of some diagnoses


class Declared(NamedTuple):
    """Of an effect, by full name of a parameter."""

    parameters: Mapping[str, Parameter]
    nominal: Mapping[str, float]  # values at which it does nothing


_known: dict[tuple[int, int], tuple[Effect, Vehicle, Declared]] = {}  # by identity, which holds while they are kept


def declared(effect: str, vehicle: Vehicle) -> Declared:
    """The parameters of an effect for a vehicle (no batch), which nobody changes in place, and their nominal values."""
    its = EFFECTS[effect]
    key = id(its), id(vehicle)
    if key not in _known:
        if len(_known) >= KEPT:
            _known.clear()
        _known[key] = its, vehicle, Declared(its.member_parameters(vehicle), its.nominal(vehicle))
    return _known[key][2]
