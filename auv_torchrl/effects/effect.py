"""An effect is a named, bounded change of a vehicle; its nominal values are the identity."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

import numpy as np
from array_api_compat import array_namespace

from auv_torchrl.array_api import converted, like
from auv_torchrl.effects.advice import Advice
from auv_torchrl.effects.trial import Trial
from auv_torchrl.quantities import percent, quantity, with_unit, words
from auv_torchrl.settings import choices
from auv_torchrl.vehicle import Vehicle

Array = Any
Values = Mapping[str, float | Array]
Change = Callable[..., Vehicle]
_DIGITS = 2  # of a quantity in a sentence; the table beside it has more


class Origin(StrEnum):
    """Where an effect acts; the value is the word used in reports."""

    ACTUATION = "actuation"
    BODY = "body"
    FLOW = "flow"
    EXTERNAL = "external"
    SENSING = "sensing"


class PartAbsent(ValueError):
    """An effect is to act on a thruster or a fin that the vehicle does not have."""


@dataclass(frozen=True)
class Parameter:
    """One number of an effect, or one per thruster or degree of freedom, with unit and bounds."""

    name: str
    unit: str
    nominal: float | Callable[[Vehicle], float | Array]
    low: float
    high: float
    sentence: (
        str  # of a report; takes {value}, {share}, {quantity} with unit, {signed} with a sign, and {which} of a family
    )
    over: tuple[str, ...] | str | None = None  # "thruster", or the names of the members
    discrete: bool = False
    guessed: float | Callable[[Vehicle, str], float] = 0.0  # standard deviation where a vehicle's file is a guess
    ordinary: float = 0.0  # what clocks, filters, brackets of a sound vehicle are off by: no finding beside a fault
    loose: float = 0.0  # standard deviation of sound sensors ...
    beside: tuple[str, ...] = ()  # ... in logs that hold some of these channels, beside which it shows; empty: in all
    at_zero: str = ""  # the sentence where the value is written as 0
    varies: float = 0.0  # standard deviation from flight to flight of a sound vehicle, members of a family together

    def members(self, vehicle: Vehicle) -> tuple[str, ...]:
        """Full names, e.g. ``gain_1`` to ``gain_6``; the name itself for a single number."""
        if self.over is None:
            return (self.name,)
        return tuple(f"{self.name}_{which}" for which in self.which(vehicle))

    def which(self, vehicle: Vehicle) -> tuple[str, ...]:
        """What the members stand for: thruster numbers or names of degrees of freedom."""
        return tuple(map(str, range(1, vehicle.thrusters + 1)) if self.over == "thruster" else self.over or ())

    def nominal_value(self, vehicle: Vehicle, member: str) -> float:
        """The value at which the effect does nothing."""
        if self.discrete:
            return float(member.rsplit("_", 1)[1])
        value: Any = self.nominal(vehicle) if callable(self.nominal) else self.nominal
        if getattr(value, "ndim", 0):  # one per thruster
            value = mean(value) if self.over is None else value[self.members(vehicle).index(member)]
        return float(value)

    def reaching(self, nominal: float) -> "Parameter":
        """The same, with bounds that hold a nominal value and room about it: some vehicles are larger than most."""
        if self.low <= nominal <= self.high:
            return self
        return replace(self, low=min(self.low, 2 * nominal), high=max(self.high, 2 * nominal))

    def sentence_of(self, member: str, value: float) -> str:
        """The sentence of a report about a member that has a value."""
        return self._sentence(self._template(value), value, words(member.removeprefix(f"{self.name}_")))

    def sentence_of_all(self, value: float) -> str:
        """The same about all members of a family that have one value."""
        template = self._template(value).replace("thruster {which}", "every thruster")
        return self._sentence(template, value, "all directions")

    def _template(self, value: float) -> str:
        return self.at_zero if self.at_zero and f"{value:z.2f}" == "0.00" else self.sentence

    def _sentence(self, template: str, value: float, which: str) -> str:
        return template.format(
            value=value,
            share=percent(value),
            quantity=quantity(value, self.unit, _DIGITS),
            signed=quantity(value, self.unit, _DIGITS, sign=True),
            which=which,
        )

    def loose_in(self, channels: Collection[str]) -> float:
        """Standard deviation by which sound sensors are off in a log with these channels."""
        return self.loose if not self.beside or set(self.beside) & set(channels) else 0.0

    @property
    def is_factor(self) -> bool:
        """Whether it multiplies what the vehicle has, and counts from the vehicle that it changes."""
        return not callable(self.nominal) and self.nominal != 0

    def guessed_within(self, vehicle: Vehicle, member: str) -> float:
        """Standard deviation of a member where the vehicle's file is a guess; 0 if it is none of its coefficients."""
        return float(self.guessed(vehicle, member) if callable(self.guessed) else self.guessed)


@dataclass(frozen=True)
class Effect:
    """A named change of a vehicle.

    ``change(vehicle, values)`` gets one array per parameter, families stacked behind the batch.
    """

    name: str
    origin: Origin
    meaning: str
    source: str
    parameters: tuple[Parameter, ...]
    change: Callable[..., Vehicle]
    shorthand: Callable[[Vehicle, Mapping[str, Any]], dict[str, Any]] | None = None
    sentence: Callable[[Mapping[str, float]], str] | None = None  # of all that departs; else one for each parameter
    of_several: str = ""  # short clause of a headline about several thrusters, {which}
    advice: Callable[[Mapping[str, float], Mapping[str, float]], tuple[Advice, ...]] | None = None  # what to do then
    is_property: bool = False  # of a vehicle for good: a file may have it wrong, but it does not come about
    trial: Trial = field(default_factory=Trial)  # how the diagnosis tries it

    def __post_init__(self):
        known = [p.name for p in self.parameters if not p.discrete]
        for key, given in (("scans", self.trial.scans), ("nuisance", self.trial.nuisance)):
            if odd := set(given) - set(known):
                raise ValueError(f"effect {self.name}: {key} of {', '.join(sorted(odd))}: {choices(odd, known)}")

    def advise(
        self, vehicle: Vehicle, values: Mapping[str, float], autopilot: Mapping[str, float]
    ) -> tuple[Advice, ...]:
        """What its owner can do where the parameters have these ``values``; nothing where none departs from nominal.

        ``autopilot`` holds the parameters of the autopilot that the log tells.
        """
        nominal = self.nominal(vehicle)
        departed = {name: value for name, value in values.items() if value != nominal[name]}
        return self.advice(departed, autopilot) if self.advice and departed else ()

    def member_parameters(self, vehicle: Vehicle) -> dict[str, Parameter]:
        """Every full parameter name for this vehicle with its declaration, whose bounds hold what the vehicle has."""
        return {
            member: p.reaching(p.nominal_value(vehicle, member)) if callable(p.nominal) else p
            for p in self.parameters
            for member in p.members(vehicle)
        }

    def nominal(self, vehicle: Vehicle) -> dict[str, float]:
        """The values at which the effect does nothing to this vehicle."""
        return {member: p.nominal_value(vehicle, member) for member, p in self.member_parameters(vehicle).items()}

    def read(self, vehicle: Vehicle, settings: Mapping[str, Any]) -> dict[str, float]:
        """Check settings from a file; the name of a family sets all of its members.

        Raises:
            ValueError: for an unknown parameter, a value that is no number or lies outside the bounds.
            PartAbsent: for the parameter of a thruster that the vehicle does not have.
        """
        settings = dict(settings)
        if self.shorthand is not None:
            settings = self.shorthand(vehicle, settings)
        declared = self.member_parameters(vehicle)
        given: dict[str, Any] = {}
        for p in self.parameters:
            if p.over is not None and p.name in settings:
                given.update(dict.fromkeys(p.members(vehicle), settings.pop(p.name)))
        given.update(settings)
        values: dict[str, float] = {}
        for name, value in given.items():
            if name not in declared:
                problem = PartAbsent if self.thruster_of(name) is not None else ValueError
                raise problem(f"effect {self.name}: no parameter {name!r}: {choices([name], declared)}")
            p = declared[name]
            if isinstance(value, bool) or not isinstance(value, int | float) or not p.low <= value <= p.high:
                bounds = with_unit(f"[{p.low:g}, {p.high:g}]", "" if p.unit == "1" else p.unit)
                raise ValueError(f"effect {self.name}: {name} is {value!r}: give a number in {bounds}")
            values[name] = float(value)
        return values

    def thruster_of(self, name: str) -> int | None:
        """The number, from 1, of the thruster that a parameter is of, whether there is such a thruster or not."""
        family, _, number = name.rpartition("_")
        is_one = number.isdecimal() and any(p.name == family and p.over == "thruster" for p in self.parameters)
        return int(number) if is_one else None

    def apply(self, vehicle: Vehicle, values: Values) -> Vehicle:
        """The changed vehicle; parameters that are not given stay nominal, batches broadcast.

        Raises:
            KeyError: for a parameter that the effect does not have.
        """
        known = [member for p in self.parameters for member in p.members(vehicle)]
        if unknown := set(values).difference(known):
            raise KeyError(f"effect {self.name}: no parameters {sorted(unknown)}: there are {', '.join(known)}")
        xp, mass = array_namespace(vehicle.mass), vehicle.mass
        given = {name: converted(value, mass) for name, value in values.items()}
        batch = np.broadcast_shapes(vehicle.batch_size, *(tuple(value.shape) for value in given.values()))
        if vehicle.batch_size != batch:
            vehicle = vehicle.expand(*batch)
        arguments = {}
        for p in self.parameters:
            members = p.members(vehicle)
            nominal = {m: converted(p.nominal_value(vehicle, m), mass) for m in members if m not in given}
            columns = [xp.broadcast_to(given[m] if m in given else nominal[m], batch) for m in members]
            arguments[p.name] = xp.stack(columns, axis=-1) if p.over is not None else columns[0]
        return self.change(vehicle, **arguments)


def of_thrusters(change: Change) -> Change:
    """A change of thrusters that leaves fins and servos, which stand among them, as they are."""

    def changed_alone(vehicle: Vehicle, **values: Array) -> Vehicle:
        after, servos = change(vehicle, **values), vehicle.servos
        thrusters = [row for row in range(vehicle.thrusters) if row not in servos]
        return among(vehicle, after, thrusters) if servos else after

    return changed_alone


def among(before: Vehicle, after: Vehicle, rows: Collection[int]) -> Vehicle:
    """What changed, of some actuators alone."""
    xp = array_namespace(before.mass)
    new = xp.asarray([row in rows for row in range(before.thrusters)], device=like(before.mass)["device"])
    fields = {}
    for name, value in after.items():
        was = before.get(name)
        if value is was:
            continue
        each = new if value.ndim == before.gain.ndim else new[..., None]
        fields[name] = xp.where(each, value, was)
    return after.replace(**fields)


def own(field: str) -> Callable[[Vehicle], Array]:
    """Nominal value of a field: its number, or one per thruster, of which a single parameter takes the mean."""
    return lambda vehicle: getattr(vehicle, field)[(0,) * vehicle.batch_dims]


def mean(values: Array) -> Array:
    """The mean over the thrusters (..., n), to the last bit where all are alike."""
    xp, first = array_namespace(values), values[..., 0]
    return first + xp.mean(values - first[..., None], axis=-1)


def changed(vehicle: Vehicle, **fields: Array) -> Vehicle:
    """The vehicle with some fields replaced, in its own precision; it shares the others."""
    return vehicle.replace(**{name: converted(value, vehicle.mass) for name, value in fields.items()})


def sets(**fields: str) -> Callable[..., Vehicle]:
    """A change that puts each parameter into a field: ``sets(delay="pose_delay")``."""
    return lambda vehicle, **values: changed(vehicle, **{fields[name]: value for name, value in values.items()})


def scales(**fields: str) -> Callable[..., Vehicle]:
    """A change that multiplies a field by each parameter: ``scales(gain="gain")``."""
    return lambda vehicle, **values: changed(
        vehicle, **{fields[name]: getattr(vehicle, fields[name]) * value for name, value in values.items()}
    )


def adds(**fields: str) -> Callable[..., Vehicle]:
    """A change that adds each parameter to a field: ``adds(angle="heading_bias")``."""
    return lambda vehicle, **values: changed(
        vehicle, **{fields[name]: getattr(vehicle, fields[name]) + value for name, value in values.items()}
    )
