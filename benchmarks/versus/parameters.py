"""What a fit leaves free: numbers with bounds, a size that a departure is measured in, and the causes that it shows.

A number that means the same as one of the library of effects has its name, ``effect.parameter``.
"""

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np

from auv_torchrl.effects import get_effect
from auv_torchrl.vehicle import Vehicle
from benchmarks.versus.toolbox import sysid

# Middle of the clear sizes that blind.sizes draws, for numbers that are 0 at a nominal vehicle. Others count as shares.
SIZES = {
    "thruster_misalignment.angle": 0.4,  # rad
    "thrust_curve.asymmetry": 0.3,
    "thruster_lag.time_constant": 0.2,  # s
    "command_delay.delay": 0.2,  # s
    "battery_sag.rate": 0.35,  # 1/min
    "buoyancy.force": 7.5,  # N
    "mass_offset": 0.05,  # m
    "drag_coupling.drag_yaw": 3.0,  # kg m/s
    "drag_coupling": 30.0,  # kg/s
    "coriolis.strength": 1.0,
    "current": 0.17,  # m/s
    "heading_bias.angle": 0.2,  # rad
    "pose_delay.delay": 0.2,  # s
    "payload.mass": 4.0,  # kg
    "payload.weight": 6.5,  # N
    "payload": 0.05,  # m
    "tether.stiffness": 10.0,  # N/m
    "tether": 4.0,  # m
    "reaction_torque": 0.016,  # m, of a T200
    "neutral_offset": 0.05,
}
# Where nothing moves with a number at its nominal value, its fit begins beside it: a lag of 0 has no derivative.
BEGIN = {"thruster_lag.time_constant": 0.02, "command_delay.delay": 0.02}  # s
SAME = {"command_delay": ("pose_delay",)}  # no log of poses parts them
# A load is a mass, a weight and a shift of the centre: who finds one of them has found it.
PARTS_OF_A_LOAD = ("added_mass", "buoyancy", "mass_offset")

Modifier = Callable[[Any, Any], object]  # writes a parameter into an MjSpec


class Free(NamedTuple):
    """One number that a fit leaves free."""

    name: str
    nominal: float
    low: float
    high: float
    begin: float
    size: float
    causes: tuple[str, ...]  # effects of the library that it shows


def of_effect(vehicle: Vehicle, effect: str, within: tuple[float, float] | None = None) -> list[Free]:
    """The numbers of an effect of the library, in its bounds, or ``within`` those that a model can hold."""
    nominal = get_effect(effect).nominal(vehicle)
    return [
        free(f"{effect}.{member}", nominal[member], *(within or (p.low, p.high)))
        for member, p in get_effect(effect).member_parameters(vehicle).items()
    ]


def size_of(name: str, nominal: float) -> float:
    """What a departure of a number is measured in: the number itself, or the middle of the sizes that are drawn."""
    size = abs(nominal) or _by_name(SIZES, name)
    if size is None:
        raise ValueError(f"{name} is 0 at a nominal vehicle and has no size: add one to SIZES")
    return size


def free(name: str, nominal: float, low: float, high: float, causes: Iterable[str] = ()) -> Free:
    """A number with its size and where its fit begins, by its name."""
    begin = _by_name(BEGIN, name)
    size = size_of(name, nominal)
    effect = name.partition(".")[0]
    shown = tuple(causes) or (effect, *SAME.get(effect, ()))  # a number that only one model has says what it shows
    if set(shown) & set(PARTS_OF_A_LOAD):
        shown = (*shown, "payload")
    return Free(name, nominal, low, high, nominal if begin is None else begin, size, tuple(dict.fromkeys(shown)))


def pointing(vehicle: Vehicle, one: Free) -> bool:
    """Whether a number moves anything: a thruster along z that is turned about z does not."""
    effect, _, member = one.name.partition(".")
    if effect != "thruster_misalignment":
        return True
    return bool(np.any(vehicle.thruster_direction[int(member.rpartition("_")[2]) - 1, :2]))


def as_sysid(frees: Iterable[Free], modifiers: dict[str, Modifier] | None = None) -> Any:
    """The same as parameters of mujoco.sysid, each at where its fit begins."""
    given = sysid.ParameterDict()
    for one in frees:
        modifier = (modifiers or {}).get(one.name)
        parameter = sysid.Parameter(one.name, one.nominal, one.low, one.high, modifier=modifier)
        parameter.value[:] = one.begin
        given.add(parameter)
    return given


def _by_name(table: dict[str, float], name: str) -> float | None:
    """The entry of the longest beginning of a name."""
    keys = [key for key in table if name.startswith(key)]
    return table[max(keys, key=len)] if keys else None
