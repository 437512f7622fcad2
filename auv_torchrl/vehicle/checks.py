"""Numbers of a vehicle file that cannot be, or hardly can: which they are, and which unit they look like.

A number by itself has bounds in :data:`auv_torchrl.vehicle.fields.VEHICLE_FIELDS`. Here stand the ratios of several:
what is large for one vehicle is small for another, so that sizes are told from the volume of displaced water. Where
numbers are out of bounds, each is converted from the units that people mistake; the one that mends them is named.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from auv_torchrl.settings import In
from auv_torchrl.vehicle.fields import BY_LABEL, GRAVITY, WATER_DENSITY, Factor

NEARLY_EQUAL = np.log(1.5)  # of conversions that lead about as near to what is typical, all are named
ROUNDED = 1e-3  # relative, of moments of inertia that are written with three digits

Floats = Any  # numpy, float64
Numbers = Mapping[str, Floats]  # by label of the entry, thrusters one by one
Conversion = tuple[str, str, Factor]  # label, unit that the number looks like, factor to the right one


@dataclass(frozen=True)
class Ratio:
    """What numbers of a vehicle come to beside each other."""

    says: str  # with the value at ``{}``
    of: Callable[[Numbers], Floats]  # one value or several, of which each has to be within
    usual: In
    typical: float  # of sound vehicles: the conversion that leads nearest to it is named
    entries: tuple[str, ...]  # that it depends on, the first to be doubted first
    possible: bool = True  # whether a vehicle outside of the interval can exist


def _size(v: Numbers) -> Floats:
    """Side in m of a cube of the displaced water."""
    return np.cbrt(_displaced(v) / WATER_DENSITY)


def _displaced(v: Numbers) -> Floats:
    """Mass of the displaced water in kg."""
    return v["rigid_body.buoyancy"] / GRAVITY


def _far(entry: str) -> Callable[[Numbers], Floats]:
    """How far from the origin, in sizes of the vehicle."""
    return lambda v: np.linalg.norm(v[entry], axis=-1).max() / _size(v)


def _drag(entry: str) -> Callable[[Numbers], Floats]:
    """Drag at 1 m/s and at 1 rad/s, over half the density times the area of the cube, and its moment."""

    def found(v: Numbers) -> Floats:
        values = np.diagonal(v[entry]) if v[entry].ndim == 2 else v[entry]
        size = _size(v)
        return values / (0.5 * WATER_DENSITY * size**2 * np.repeat((1.0, size**3), 3))

    return found


def _stopping(v: Numbers) -> Floats:
    return (_drag("linear_drag")(v) + _drag("quadratic_drag")(v))[:3].min()


def _triangle(v: Numbers) -> Floats:
    moments = v["rigid_body.inertia"]
    return moments.max() / (moments.sum() - moments.max())


def _added(v: Numbers) -> Floats:
    return v["added_mass"] / (_displaced(v) * np.repeat((1.0, _size(v) ** 2), 3))


def _righting(v: Numbers) -> Floats:
    return (v["rigid_body.centre_of_mass"] - v["rigid_body.centre_of_buoyancy"])[2] / _size(v)


def _hull(v: Numbers) -> Floats:
    height = v["rigid_body.hull_height"]
    return height[height > 0] / _size(v)  # 0 is that of a cube


_THRUST, _LIMIT, _BAND = "thrusters.full_thrust", "thrusters.limit", "thrusters.dead_band"
_AREA, _TURNS = "fins.area", "servos.turns"


def _strongest(v: Numbers) -> Floats:
    return np.array([]) if v[_AREA].any() or v[_TURNS].any() else v[_THRUST].max() / v["rigid_body.buoyancy"]


ALONG = 0.9  # of a thrust along the axis of its servo, from which on turning hardly turns it


def _wrong_servo(v: Numbers) -> str | None:
    """What is impossible about the servos that turn thrusters, in words; None for nothing."""
    turns, is_fin, direction = v[_TURNS], v[_AREA] > 0, v["thrusters.direction"]
    pushing = (np.flatnonzero(~is_fin & (turns == 0)) + 1).tolist()
    turned: dict[int, int] = {}
    for row, number in enumerate(turns.tolist(), start=1):
        if number == 0:
            continue
        if is_fin[row - 1]:
            return f"{_TURNS} has {number:g} for number {row}, which is a fin: give 0 there, or {_AREA} 0"
        if number not in pushing:
            return (
                f"{_TURNS} has {number:g} for number {row}: give the number of a thruster that pushes ({pushing}), or 0"
            )
        thruster = int(number)
        if thruster in turned:
            return f"{_TURNS} has {thruster} for numbers {turned[thruster]} and {row}: a thruster has one servo"
        if (along := abs(float(direction[row - 1] @ direction[thruster - 1]))) > ALONG:
            return (
                f"thruster {thruster} pushes by {along:.2g} of its thrust along the axis of servo {row}, which so "
                "turns nothing: thrusters.direction of a servo is the axis about which it turns"
            )
        turned[thruster] = row
    return None


RATIOS = (
    Ratio("the largest moment of inertia is {} times the sum of the others, which no body has", _triangle,
          In(f"(0, {1 + ROUNDED}]"), 0.5, ("rigid_body.inertia",), possible=False),
    Ratio("the dead band is {} times the largest thrust, so that a thruster never pushes",
          lambda v: v[_BAND] / np.minimum(v[_THRUST], v[_LIMIT]), In("[0, 1]"), 0.05, (_BAND, _LIMIT, _THRUST),
          possible=False),
    Ratio("the largest number of the mixer is {}, so that no command reaches a thruster",
          lambda v: np.abs(v["mixer"]).max(), In("(0, inf)"), 1.0, ("mixer",), possible=False),
    Ratio("the weight is {} times the buoyancy", lambda v: v["rigid_body.mass"] / _displaced(v),
          In("[0.6, 1.7]"), 1.0, ("rigid_body.buoyancy", "rigid_body.mass")),
    Ratio("the farthest thruster is {} times the size of the hull away", _far("thrusters.position"),
          In("[0, 10]"), 1.0, ("thrusters.position", "rigid_body.buoyancy")),
    Ratio("the centre of mass is {} times the size of the hull away", _far("rigid_body.centre_of_mass"),
          In("[0, 5]"), 0.1, ("rigid_body.centre_of_mass", "rigid_body.buoyancy")),
    Ratio("the centre of buoyancy is {} times the size of the hull away", _far("rigid_body.centre_of_buoyancy"),
          In("[0, 5]"), 0.1, ("rigid_body.centre_of_buoyancy", "rigid_body.buoyancy")),
    Ratio("the centre of buoyancy is {} times the size of the hull above the centre of mass, below 0 it capsizes",
          _righting, In("[0, 3]"), 0.1, ("rigid_body.centre_of_buoyancy", "rigid_body.centre_of_mass")),
    Ratio("the height of the hull is {} times its size", _hull, In("[0.05, 10]"), 1.0,
          ("rigid_body.hull_height", "rigid_body.buoyancy")),
    Ratio("the Doppler log is {} times the size of the hull away", _far("sensors.dvl_position"),
          In("[0, 10]"), 0.5, ("sensors.dvl_position", "rigid_body.buoyancy")),
    Ratio("the accelerometer is {} times the size of the hull away", _far("sensors.accelerometer_position"),
          In("[0, 10]"), 0.5, ("sensors.accelerometer_position", "rigid_body.buoyancy")),
    Ratio("the radius of gyration is {} times the size of the hull",
          lambda v: np.sqrt(v["rigid_body.inertia"] / v["rigid_body.mass"]) / _size(v),
          In("[0.05, 4]"), 0.5, ("rigid_body.inertia", "rigid_body.mass", "rigid_body.buoyancy")),
    Ratio("the added mass is {} times that of the displaced water", _added,
          In("[0, 30]"), 0.5, ("added_mass", "rigid_body.buoyancy")),
    Ratio("the linear drag coefficient at 1 m/s or 1 rad/s is {}", _drag("linear_drag"),
          In("[0, 100]"), 0.5, ("linear_drag", "rigid_body.buoyancy")),
    Ratio("the quadratic drag coefficient is {}", _drag("quadratic_drag"),
          In("[0, 100]"), 2.0, ("quadratic_drag", "rigid_body.buoyancy")),
    Ratio("the least drag coefficient in surge, sway and heave at 1 m/s is {}, so that it hardly stops", _stopping,
          In("[0.005, inf)"), 2.0, ("quadratic_drag", "linear_drag")),
    # Vehicles that hover have 0.05 (Girona 500) to 0.5 (BlueROV2); one with fins less, which is not asked.
    Ratio("the strongest thruster pushes with {} times the weight of the displaced water",
          _strongest, In("[0.05, 20]"), 0.3, (_THRUST, "rigid_body.buoyancy")),
    Ratio("the lift of a fin points {} of it ahead, where the flow comes from",
          lambda v: np.abs(v["thrusters.direction"][:, 0])[v[_AREA] > 0], In("[0, 0.9]"), 0.05,
          ("thrusters.direction", _AREA), possible=False),
    Ratio("the limit is {} times the full thrust", lambda v: v[_LIMIT] / v[_THRUST],
          In("[0.15, 100]"), 1.0, (_LIMIT, _THRUST)),
    Ratio("the dead band is {} times the full thrust", lambda v: v[_BAND] / v[_THRUST],
          In("[0, 0.6]"), 0.05, (_BAND, _THRUST)),
    Ratio("the moment of a propeller is {} times its thrust at the size of the hull",
          lambda v: np.abs(v["thrusters.reaction"]) / _size(v), In("[0, 0.6]"), 0.07,
          ("thrusters.reaction", "rigid_body.buoyancy")),
    Ratio("the largest number in a row of the mixer is {}, so that a thruster is never commanded",
          lambda v: np.abs(v["mixer"]).max(-1), In("(0, inf)"), 1.0, ("mixer",)),
)  # fmt: skip


def _own_bounds(name: str) -> Ratio:
    """The bounds of a number by itself, as a ratio."""
    return Ratio(f"{name} is {{}}", lambda v: v[name], BY_LABEL[name].usual, np.nan, (name,))


_CHECKS = (*RATIOS, *(_own_bounds(name) for name, kind in BY_LABEL.items() if kind.usual != In("(-inf, inf)")))


def impossible(v: Numbers) -> str | None:
    """What is impossible about a vehicle's numbers beside each other, in words; None for nothing."""
    return _wrong_servo(v) or next(_sentences(v, tuple(ratio for ratio in _CHECKS if not ratio.possible)), None)


def doubts(v: Numbers) -> tuple[str, ...]:
    """What is implausible about a vehicle's numbers, one sentence each; empty for nothing."""
    return tuple(_sentences(v, tuple(ratio for ratio in _CHECKS if ratio.possible)))


def looks_like(name: str, value: Floats) -> str:
    """The unit of an entry that is out of its own bounds, as the end of a sentence; empty where none fits."""
    kind = BY_LABEL[name]
    fits = [
        unit
        for unit, factor in kind.mistaken.items()
        if all(number in kind.given and number in kind.usual for number in np.ravel(_scaled(value, factor)))
    ]
    return f"; this looks like {' or '.join(fits)}" if fits else ""


def _sentences(v: Numbers, ratios: tuple[Ratio, ...]) -> Iterator[str]:
    with np.errstate(all="ignore"):  # what overflows is out of every interval
        wrong = [ratio for ratio in ratios if _worst(ratio, v) is not None]
        if not wrong:
            return
        suspects = {name for ratio in wrong for name in ratio.entries}
        mended = {
            tuple(conversions): _outcome({**v, **{name: _scaled(v[name], by) for name, _, by in conversions}})
            for conversions in _conversions(suspects)
        }
        now = _outcome(v)
        by_remedy: dict[str, str] = {}
        for ratio in wrong:
            what, remedy = _sentence(ratio, v, now, mended)
            by_remedy.setdefault(remedy, what)  # one mistake shows in several ratios, and is named once
        yield from (f"{what}: {remedy}" for remedy, what in by_remedy.items())


def _sentence(
    ratio: Ratio, v: Numbers, now: dict[Ratio, float], mended: dict[tuple[Conversion, ...], dict[Ratio, float]]
) -> tuple[str, str]:
    """What is wrong with a ratio, and the conversions that put it right and nothing else wrong."""
    distance = {
        conversions: sum(outcome[other] for other in now if other in outcome)
        for conversions, outcome in mended.items()
        if {name for name, _, _ in conversions} & set(ratio.entries)
        and np.isfinite(outcome[ratio])
        and all(np.isfinite(outcome[other]) for other in now if np.isfinite(now[other]))
    }
    fixed = {c: sum(np.isfinite(mended[c][other]) for other in now) for c in distance}
    best = [c for c in distance if fixed[c] == max(fixed.values())]
    near = min((distance[c] for c in best), default=0.0)
    chosen = [c for c in best if distance[c] <= near + NEARLY_EQUAL]
    fewest = min(map(len, chosen), default=0)
    listed = [_converted(c) for c in chosen if len(c) == fewest]
    remedy = ", or ".join(dict.fromkeys(listed)) if listed else f"check {' and '.join(ratio.entries)}"
    return f"{ratio.says.format(f'{_worst(ratio, v):.3g}')} ({_expected(ratio)})", remedy


def _expected(ratio: Ratio) -> str:
    low, high = (end.strip() for end in ratio.usual.interval[1:-1].split(","))
    unit = f" {ratio.usual.unit}" if ratio.usual.unit else ""
    span = f"more than {low}{unit}" if high == "inf" else f"{low} to {high}{unit}"
    return f"{'usual' if ratio.possible else 'possible'}: {span}"


def _converted(conversions: tuple[Conversion, ...]) -> str:
    names, unit = [name for name, _, _ in conversions], conversions[0][1]
    look = "looks" if len(names) == 1 else "look"
    return f"{' and '.join(names)} {look} like {unit}, give {BY_LABEL[names[0]].unit or 'shares of 1'}"


def _conversions(names: set[str]) -> Iterator[tuple[Conversion, ...]]:
    """Each entry from each unit that it is mistaken in, alone, and with those of its section that have the same one."""
    for name in sorted(names):
        for unit, factor in BY_LABEL[name].mistaken.items():
            yield ((name, unit, factor),)
            section = name.rpartition(".")[0]
            others = [
                (other, unit, kind.mistaken[unit])
                for other, kind in BY_LABEL.items()
                if other.rpartition(".")[0] == section and kind.unit == BY_LABEL[name].unit and unit in kind.mistaken
            ]
            if len(others) > 1:
                yield tuple(others)


def _outcome(v: Numbers) -> dict[Ratio, float]:
    """By ratio, how far from typical in powers of e its values are at most; infinite where one is out of bounds."""
    found = {}
    for ratio in _CHECKS:
        values = np.abs(np.ravel(ratio.of(v)))
        if _worst(ratio, v) is not None:
            found[ratio] = np.inf
        elif np.isnan(ratio.typical) or not (values > 0).any():
            found[ratio] = 0.0
        else:
            found[ratio] = float(np.abs(np.log(values[values > 0] / ratio.typical)).max())
    return found


def _worst(ratio: Ratio, v: Numbers) -> float | None:
    """The value of a ratio that is farthest out of its interval; None where all are within."""
    outside = [value for value in np.ravel(ratio.of(v)).tolist() if value not in ratio.usual]
    return max(outside, key=lambda value: abs(np.log(abs(value))) if value else np.inf) if outside else None


def _scaled(value: Floats, factor: Factor) -> Floats:
    """A number, a vector, or rows of vectors times a factor, or one factor per entry of the vectors."""
    return value * np.asarray(factor)
