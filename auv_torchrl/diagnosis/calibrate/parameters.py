"""The uncertain numbers of a vehicle, and a vehicle with the covariance of these numbers.

A number is a parameter of an effect. Two reasons make a number uncertain although nothing is wrong: the vehicle's file
may have it wrong, which is the same in every flight, and flights differ in it, as in trim and current.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from auv_torchrl.diagnosis.identify.hypotheses import (
    Entry,
    Settings,
    Values,
    apply_values,
    nuisance_parameters,
    sensor_nuisance,
    that_matter,
)
from auv_torchrl.diagnosis.identify.problem import NuisanceEntry
from auv_torchrl.diagnosis.motion.windows import Floats, Windows
from auv_torchrl.diagnosis.thresholds import MENDED_REPEATS, REPEATS, SHARED_BY_THRUSTERS
from auv_torchrl.effects import EFFECTS, get_effect
from auv_torchrl.vehicle import Vehicle, read_vehicle_file

WARMTH = 0.4  # share of the offset of a healthy sensor that comes and goes with temperature
LEAST_SHARE = 1e-9  # of a number's variance, for the file: a width of 0 has no inverse
TINY = 0.01  # share of the nominal value, below which a file says nothing that a correction could be a share of
# Least factor of a number: no factor brings back what is gone, and the largest factors, of 10, bring this back.
SMALLEST_FACTOR = 0.1


@dataclass(frozen=True)
class Coefficient:
    """An uncertain number of a vehicle's file, as the parameter of the effect that changes it."""

    effect: str
    member: str
    nominal: float
    width: float  # prior standard deviation, in the parameter's unit
    low: float
    high: float
    unit: str


def make_coefficients(entries: Iterable[NuisanceEntry], vehicle: Vehicle) -> tuple[Coefficient, ...]:
    """The coefficients of nuisance parameters, with the bounds and units that the effects declare."""
    found = []
    for effect, member, nominal, width in entries:
        p = get_effect(effect).member_parameters(vehicle)[member]
        found.append(Coefficient(effect, member, nominal, width, p.low, p.high, p.unit))
    return tuple(found)


def load_uncertainty(name: str | Path, vehicle: Vehicle) -> tuple[Coefficient, ...]:
    """The uncertain coefficients of the vehicle of that name in ``conf/vehicle``, or of that YAML file."""
    return read_uncertainty(read_vehicle_file(name).get("uncertainty"), vehicle)


def read_uncertainty(content: Mapping[str, Any] | None, vehicle: Vehicle) -> tuple[Coefficient, ...]:
    """The section ``uncertainty`` of a vehicle file: ``{effect: {parameter or family: standard deviation}}``.

    Args:
        content: the section; None or empty where the coefficients are certain.
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
        names = {p.name for p in effect.parameters} | set(declared)
        if unknown := set(widths) - names:
            raise ValueError(f"uncertainty: {name} has no {sorted(unknown)}: there are {', '.join(sorted(names))}")
        for member, p in declared.items():
            width = widths.get(member, widths.get(p.name))
            if width is None:
                continue
            if isinstance(width, bool) or not isinstance(width, int | float) or not 0 < width < float("inf"):
                raise ValueError(f"uncertainty: {name}.{member} is {width!r}: give a positive number of {p.unit}")
            found.append(Coefficient(name, member, nominal[member], float(width), p.low, p.high, p.unit))
    return tuple(found)


def shared_covariance(members: Sequence[tuple[str, str]], width: Floats) -> Floats:
    """Covariance (k, k) of the errors of a file in ``members``, (effect, parameter), each within ``width`` (k,).

    Some causes, such as the battery's volts, make all thrusters differ from flight to flight. The same causes make the
    file wrong of all thrusters. Without a shared error a fit bends the curve of thrust instead of paying once for each
    thruster. A bent curve is wrong at commands larger than those of the log.
    """
    families = [shared_family(*member) for member in members]
    same = np.array([[one is not None and one == other for other in families] for one in families])
    return np.outer(width, width) * np.where(np.eye(len(width), dtype=bool), 1.0, SHARED_BY_THRUSTERS * same)


def shared_family(effect: str, member: str) -> tuple[str, str] | None:
    """The effect and the family whose members differ together from flight to flight; None for a lone parameter."""
    for p in get_effect(effect).parameters:
        if p.varies and p.over is not None and member.startswith(f"{p.name}_"):
            return effect, p.name
    return None


@dataclass(frozen=True)
class NuisanceParameters:
    """Numbers (k,) that are uncertain about a vehicle anyway: no effect is to be made of them."""

    entries: tuple[NuisanceEntry, ...]  # the width of each holds the file's error and the spread of flights
    width: Floats  # (k,) standard deviation of the file's error; 0 where the file is right
    spread: tuple[Floats, ...]  # (k, k) covariances between flights; the size of each can be learnt
    repeats: Floats  # (k,) standard deviation within which every healthy vehicle repeats itself
    repeating: float = REPEATS  # relative, how well a healthy vehicle repeats itself
    is_guess: bool = False  # whether the file is a guess: then errors of thrusters are shared

    def between_flights(self, sizes: Sequence[float] | None = None) -> Floats:
        """Covariance (k, k) between flights; ``sizes`` multiply the standard deviation of each spread."""
        sizes = [1.0] * len(self.spread) if sizes is None else sizes
        parts = (size**2 * part for size, part in zip(sizes, self.spread, strict=True))
        return sum(parts, np.diag(self.repeats**2))

    def only(self, places: Sequence[int]) -> "NuisanceParameters":
        """The numbers at these places."""
        spread = tuple(part[np.ix_(places, places)] for part in self.spread)
        entries = tuple(self.entries[i] for i in places)
        return replace(self, entries=entries, width=self.width[places], spread=spread, repeats=self.repeats[places])

    def precision(self, width: Floats) -> Floats:
        """Precision (k, k) of a file that is right within ``width`` (k,)."""
        total = np.array([entry[3] for entry in self.entries])
        width = np.maximum(width, LEAST_SHARE**0.5 * total)
        members = [entry[:2] for entry in self.entries]
        return np.linalg.inv(shared_covariance(members, width) if self.is_guess else np.diag(width**2))


def make_nuisance(vehicle: Vehicle, widths: Sequence[NuisanceEntry]) -> NuisanceParameters:
    """The numbers that a file has wrong by ``widths``, and all numbers that flights differ in."""
    width = {(effect, member): (nominal, size) for effect, member, nominal, size in widths}
    varying: dict[str, list[tuple[tuple[str, str], float]]] = {}
    differing = [
        (name, member, p.nominal_value(vehicle, member), p.varies)
        for name, effect in EFFECTS.items()
        for member, p in effect.member_parameters(vehicle).items()
        if p.varies and (not effect.trial.shown_by or (name, member) in width)
    ]
    for name, member, nominal, varies in that_matter(vehicle, differing):
        family = get_effect(name).member_parameters(vehicle)[member].name
        varying.setdefault(f"{name}.{family}", []).append(((name, member), varies))
        width.setdefault((name, member), (nominal, 0.0))
    keys, spread = list(width), []
    for members in varying.values():
        column = np.zeros(len(keys))
        for key, size in members:
            column[keys.index(key)] = size
        spread.append(np.outer(column, column))
    repeats = _repeat_widths(vehicle, keys, [nominal for nominal, _ in width.values()])
    own = np.array([size for _, size in width.values()])
    total = np.sqrt(own**2 + repeats**2 + sum(np.diag(part) for part in spread)).tolist()
    entries = tuple((*key, width[key][0], size) for key, size in zip(keys, total, strict=True))
    return NuisanceParameters(entries, own, tuple(spread), repeats)


def _repeat_widths(
    vehicle: Vehicle, keys: Sequence[tuple[str, str]], nominal: Sequence[float], share: float = REPEATS
) -> Floats:
    """Standard deviations (k,) within which healthy vehicles repeat the numbers ``keys``, about ``nominal`` (k,)."""
    loose = [EFFECTS[effect].member_parameters(vehicle)[member].loose for effect, member in keys]
    return np.array([share * abs(value) or WARMTH * size for value, size in zip(nominal, loose, strict=True)])


def state_nuisance(vehicle: Vehicle, settings: Settings, channels: Collection[str] = ()) -> NuisanceParameters:
    """The numbers of a vehicle whose file is right within the settings' widths, for logs with these ``channels``."""
    return make_nuisance(vehicle, nuisance_parameters(vehicle, settings, channels))


def guess_nuisance(
    vehicle: Vehicle, settings: Settings, coefficients: Sequence[Coefficient], windows: Windows
) -> NuisanceParameters:
    """The numbers of a vehicle whose file is a guess: ``coefficients``, and guesses of what the file does not state.

    Some effects say the same in other numbers. Such an effect takes part where the file states some of its numbers.
    An effect that smooths commands takes no part where commands were logged as snapshots: snapshots are noisy, and
    smoothed ones predict better, whatever the thrusters do. A delay stands for the effect.
    """
    effects = {c.effect for c in coefficients}
    members = {(c.effect, c.member) for c in coefficients}
    covered = {name for effect in effects for name in EFFECTS[effect].trial.covers}
    others = {name for name, effect in EFFECTS.items() if name in effects or not effect.trial.covers} - covered
    widths = [(c.effect, c.member, c.nominal, c.width) for c in coefficients]
    widths += [entry for entry in list_guesses(vehicle) if entry[0] in others and entry[:2] not in members]
    if windows.errors.snapshot_s:
        widths = [entry for entry in widths if not EFFECTS[entry[0]].trial.smooths]
    found = make_nuisance(vehicle, [*widths, *sensor_nuisance(vehicle, settings, windows.channels)])
    return replace(found, repeating=MENDED_REPEATS, is_guess=True)


def list_guesses(vehicle: Vehicle) -> list[Entry]:
    """Every number that a file may have wrong."""
    found: list[Entry] = []
    for name, effect in EFFECTS.items():
        for member, p in effect.member_parameters(vehicle).items():
            width = p.guessed_within(vehicle, member)
            nominal = p.nominal_value(vehicle, member)
            if width:
                found.append((name, member, nominal, width))
    return that_matter(vehicle, found)


@dataclass(frozen=True)
class VehicleEstimate:
    """A vehicle, and the covariance of what another flight will show of its nuisance parameters."""

    vehicle: Vehicle  # empty batch
    nuisance: NuisanceParameters  # about that vehicle
    file_offset: Floats  # (k,) the file's numbers less those of the vehicle
    covariance: Floats  # (k, k) of what another flight will show

    @staticmethod
    def from_file(file: Vehicle, nuisance: NuisanceParameters) -> "VehicleEstimate":
        """The vehicle as its file says, before any flight."""
        covariance = np.diag(nuisance.width**2) + nuisance.between_flights()
        return VehicleEstimate(file, nuisance, np.zeros(len(nuisance.entries)), covariance)

    @staticmethod
    def without_spread(vehicle: Vehicle, entries: Sequence[NuisanceEntry], covariance: Floats) -> "VehicleEstimate":
        """A vehicle whose numbers are as uncertain as ``covariance`` (k, k); no further flight is to teach of them."""
        nothing = np.zeros(len(entries))
        return VehicleEstimate(vehicle, NuisanceParameters(tuple(entries), nothing, (), nothing), nothing, covariance)

    @property
    def corrections(self) -> dict[tuple[str, str], float]:
        """By effect and parameter, the correction of a number as a share of what the file says.

        An offset counts from nothing: its correction is no share.
        """
        entries = zip(self.nuisance.entries, self.file_offset, strict=True)
        there = [(entry, entry[2] + offset, offset) for entry, offset in entries]
        return {
            (effect, member): float(-offset / abs(value))
            for (effect, member, nominal, _), value, offset in there
            if abs(value) > TINY * abs(nominal) > 0
        }

    @property
    def file_prior(self) -> tuple[Floats, Floats]:
        """The deviations (k,) that the file lets expect, and their precision (k, k).

        A factor is as likely to be wrong by 2 as by a half, so deviations of factors are logarithms. Squares of plain
        deviations would take a vehicle for too small whose scale no log tells.
        """
        width, nominal = self.nuisance.width, np.array([entry[2] for entry in self.nuisance.entries])
        is_factor = self._is_factor
        by = np.where(is_factor, nominal, 1.0)
        times = np.where(is_factor, np.maximum(1 + self.file_offset / by, SMALLEST_FACTOR), 1.0)  # file over vehicle
        offset = np.where(is_factor, nominal * np.log(times), self.file_offset)
        # The width of a factor is that of its logarithm: relative to the file's number, not to the vehicle's.
        return offset, self.nuisance.precision(width / times)

    @property
    def _is_factor(self) -> np.ndarray:
        """(k,) whether each number is a factor."""
        members = (entry[:2] for entry in self.nuisance.entries)
        return np.array(
            [EFFECTS[effect].member_parameters(self.vehicle)[name].is_factor for effect, name in members], bool
        )

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Least and largest deviation (k,) of each number."""
        room = []
        for effect, member, nominal, _ in self.nuisance.entries:
            p = EFFECTS[effect].member_parameters(self.vehicle)[member]
            room.append((p.low - nominal, p.high - nominal))
        low, high = np.array(room).T
        return low, high

    def updated(self, deviation: Floats, covariance: Floats, sizes: Sequence[float] | None = None) -> "VehicleEstimate":
        """The vehicle with the deviation (k,) that flights show, which they leave open by ``covariance`` (k, k).

        ``sizes`` multiply the standard deviation of each spread between flights.
        """
        there = replace(self, covariance=covariance).shifted(deviation)
        return there.with_covariance(there.covariance + there.nuisance.between_flights(sizes))

    def shifted(self, deviation: Floats) -> "VehicleEstimate":
        """The vehicle with a deviation (k,), as uncertain as before.

        A factor counts from the vehicle that it changes: a gain of 0.8 that became 1 keeps its relative uncertainty.
        """
        own = apply_values(self.vehicle, self._values(deviation))
        nominal = [EFFECTS[effect].nominal(own)[member] for effect, member, *_ in self.nuisance.entries]
        before = np.array([entry[2] for entry in self.nuisance.entries])
        is_factor = self._is_factor
        gone = is_factor & (np.abs(before + deviation) < SMALLEST_FACTOR * np.abs(before))
        if gone.any():
            deviation = np.where(gone, (SMALLEST_FACTOR - 1) * before, deviation)
            own = apply_values(self.vehicle, self._values(deviation))
        factor = np.where(is_factor, before / np.where(is_factor, before + deviation, 1.0), 1.0)
        entries = tuple((*s[:2], new, s[3]) for s, new in zip(self.nuisance.entries, nominal, strict=True))
        keys = [(effect, member) for effect, member, *_ in entries]
        repeats = _repeat_widths(own, keys, nominal, self.nuisance.repeating)
        width = self.nuisance.width * np.abs(factor)
        nuisance = replace(self.nuisance, entries=entries, width=width, repeats=repeats)
        there = VehicleEstimate(own, nuisance, (self.file_offset - deviation) * factor, self.covariance)
        return there.with_covariance(self.covariance * np.outer(factor, factor))

    def with_covariance(self, covariance: Floats) -> "VehicleEstimate":
        """The same vehicle with a covariance (k, k), which also gives the width of each entry."""
        size = np.sqrt(np.diag(covariance)).tolist()
        entries = tuple((*entry[:3], s) for entry, s in zip(self.nuisance.entries, size, strict=True))
        return replace(self, nuisance=replace(self.nuisance, entries=entries), covariance=covariance)

    def without_fixed_properties(self) -> "VehicleEstimate":
        """The same vehicle without the numbers of effects that never come about, as the places of its thrusters.

        The file may have such numbers wrong. Once they are calibrated, no search needs them as nuisance parameters.
        """
        fixed = {name for name, effect in EFFECTS.items() if effect.is_property and not effect.trial.is_searched}
        places = [place for place, (effect, *_) in enumerate(self.nuisance.entries) if effect not in fixed]
        covariance = self.covariance[np.ix_(places, places)]
        return VehicleEstimate(self.vehicle, self.nuisance.only(places), self.file_offset[places], covariance)

    def _values(self, deviation: Floats) -> Values:
        """Effect values with a deviation (k,), within their bounds: a mean over flights knows of none."""
        values: Values = {}
        for (effect, member, nominal, _), by in zip(self.nuisance.entries, deviation.tolist(), strict=True):
            p = EFFECTS[effect].member_parameters(self.vehicle)[member]
            values.setdefault(effect, {})[member] = min(max(nominal + by, p.low), p.high)
        return values
