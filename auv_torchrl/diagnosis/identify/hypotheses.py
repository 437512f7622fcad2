"""What could be wrong: every effect as a few candidates, and the nuisance parameters of a healthy vehicle."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations
from typing import Annotated, Any, NamedTuple

import numpy as np

from auv_torchrl.array_api import converted
from auv_torchrl.diagnosis.latest import Latest
from auv_torchrl.effects import EFFECTS, Effect, Parameter
from auv_torchrl.effects.trial import Same, Scan
from auv_torchrl.settings import Entries, In, read_settings
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


Values = dict[str, dict[str, float]]  # effect -> parameter -> value
Entry = tuple[str, str, float, float]  # effect, parameter, nominal value, prior standard deviation
UNCHANGED: Latest[Vehicle] = Latest(16)  # batches of a vehicle as it is
DEFAULT_SCAN = 7  # values across the bounds of a parameter that declares no values to try


@dataclass(frozen=True)
class Candidate:
    """One concrete change: parameters of one effect at given values.

    A continuous candidate may act by any amount near 1 (``elastic``) or at all (not), 0 being the nominal vehicle.
    """

    effect: str
    values: dict[str, float]
    discrete: bool = False
    elastic: bool = True


@dataclass(frozen=True)
class Settings:
    """``conf/diagnosis/*.yaml``."""

    window_s: Annotated[float, In("[0.5, 60]")]
    lead_s: Annotated[float, In("[0, 60]")]
    bin_s: Annotated[float, In("[0.05, 10]")]
    floor_force: Annotated[tuple[float, ...], In("(0, 10000]"), Entries(6, 6)]
    prior_none: Annotated[float, In("(0, 1)")]
    nuisance: dict[str, dict[str, float]]
    scan: dict[str, dict[str, Any]]
    ignored: tuple[str, ...] | None
    thresholds: tuple[str, ...] | None
    excess: Annotated[float, In("[1, 1000]")]
    most_effects: Annotated[int, In("[1, 20]")]
    tempering: Annotated[float, In("(0, 1]")]

    @property
    def left_out(self) -> tuple[str, ...]:
        """Names of the effects that are not looked for."""
        unasked = (name for name, effect in EFFECTS.items() if effect.trial.is_noise or not effect.trial.is_searched)
        return tuple(unasked) if self.ignored is None else self.ignored

    def is_rough(self, effect: str) -> bool:
        """Whether chi-square is rough in the values of an effect."""
        return EFFECTS[effect].trial.is_rough if self.thresholds is None else effect in self.thresholds

    def nuisance_of(self, effect: Effect) -> Mapping[str, float]:
        """Relative standard deviations, by parameter, by which a sound vehicle is off."""
        return self.nuisance.get(effect.name, effect.trial.nuisance)

    def scans_of(self, effect: Effect) -> Mapping[str, Scan]:
        """Values to try, by parameter."""
        if effect.name in self.scan:
            return {name: Scan(**given) for name, given in self.scan[effect.name].items() if name != "together"}
        return effect.trial.scans

    def together_of(self, effect: Effect) -> Sequence[Mapping[str, float]]:
        """Values of several parameters to try at once; where there are some, the parameters are not tried alone."""
        return self.scan[effect.name].get("together", ()) if effect.name in self.scan else effect.trial.together


def load_settings(name: str = "default") -> Settings:
    """Read settings; the fields are commented in the file.

    Raises:
        FileNotFoundError: for an unknown name.
        ValueError: for a missing, unknown or impossible entry, naming it.
    """
    return read_settings(Settings, "diagnosis", name)


def apply_values(vehicle: Vehicle, values: Mapping[str, Mapping[str, Any]]) -> Vehicle:
    """The vehicle with several effects, in the order of the registry; the values may be batches."""
    for name, effect in EFFECTS.items():
        if name in values:
            vehicle = effect.apply(vehicle, values[name])
    return vehicle


def batch(vehicle: Vehicle, rows: list[Values]) -> Vehicle:
    """One vehicle per entry of ``rows``, as a batch.

    Raises:
        KeyError: for a parameter that its effect does not have.
    """
    names = {name for row in rows for name in row}
    changed = UNCHANGED.of(lambda: vehicle.expand(len(rows)), (vehicle,), len(rows))
    for name in (name for name in EFFECTS if name in names):
        _, nominal, places = declared(name, vehicle)
        each = [nominal | row.get(name, {}) for row in rows]
        if unknown := {member for its in each if len(its) > len(nominal) for member in its.keys() - nominal.keys()}:
            raise KeyError(f"effect {name}: no parameters {sorted(unknown)}: there are {', '.join(nominal)}")
        values = converted(np.array([list(its.values()) for its in each]), vehicle.mass)
        changed = EFFECTS[name].change(changed, **{p: values[:, place] for p, place in places.items()})
    return changed


def make_candidates(vehicle: Vehicle, settings: Settings, effects: Mapping[str, Effect] = EFFECTS) -> list[Candidate]:
    """All changes to try on this vehicle."""
    candidates: list[Candidate] = []
    for name, effect in effects.items():
        if name in settings.left_out:
            continue
        together, scans = settings.together_of(effect), settings.scans_of(effect)
        if any(p.discrete for p in effect.parameters):
            candidates += _permutations(effect, vehicle)
        elif together:
            candidates += [Candidate(name, dict(values)) for values in together]
        else:
            for p in effect.parameters:
                candidates += _one_by_one(effect, p, vehicle, scans.get(p.name))
    tried = {candidate.effect for candidate in candidates}
    candidates = [
        one for one in candidates if plainer_names(effects[one.effect], vehicle, one.values.items(), tried) is None
    ]
    acts = do_change(vehicle, [(candidate.effect, candidate.values) for candidate in candidates])
    return [candidate for candidate, does in zip(candidates, acts, strict=True) if does]


def plainer_names(
    effect: Effect, vehicle: Vehicle, values: Iterable[tuple[str, float]], tried: Collection[str]
) -> list[Same] | None:
    """What values of an effect are better called, by effects that are tried; None where one has no other name."""
    if effect.trial.same_as is None:
        return None
    same = [effect.trial.same_as(vehicle, *value) for value in values]
    known = [one for one in same if one is not None and one[0] in tried]
    return known if len(known) == len(same) else None


def _one_by_one(effect: Effect, p: Parameter, vehicle: Vehicle, scan: Scan | None) -> list[Candidate]:
    members = p.members(vehicle)
    nominal = {member: p.nominal_value(vehicle, member) for member in members}
    scan = scan or Scan(tuple(float(v) for v in np.linspace(p.low, p.high, DEFAULT_SCAN)))
    groups: list[tuple[str, ...]] = [(member,) for member in members]
    if len(members) > 1 and scan.all and len(set(nominal.values())) == 1:
        groups.append(members)  # a term is one value; members that differ have none in common
    found = []
    for group in groups:
        now = nominal[group[0]]
        values = [v * now if scan.relative else v for v in scan.values]
        found += [
            Candidate(effect.name, dict.fromkeys(group, float(value)), elastic=not scan.linear)
            for value in values
            if p.low <= value <= p.high and value != now
        ]
    return found


def _permutations(effect: Effect, vehicle: Vehicle) -> list[Candidate]:
    """Exchanges of two thrusters, 3-cycles of those that are all horizontal or all vertical, and opposite commands."""
    n = vehicle.thrusters
    rings: list[tuple[int, ...]] = [(i, j) for i, j in combinations(range(1, n + 1), 2)]
    upright = np.abs(vehicle.thruster_direction[..., 2]).reshape(-1, n)[0] > 0.5
    for trio in combinations(range(1, n + 1), 3):
        if len({bool(upright[i - 1]) for i in trio}) == 1:
            first, *rest = trio
            rings += [(first, *order) for order in permutations(rest)]
    key = effect.parameters[0].name
    changes = [
        {f"{key}_{receiver}": float(giver) for giver, receiver in zip(ring, ring[1:] + ring[:1], strict=True)}
        for ring in rings
    ]
    changes += [{f"{key}_{i}": -float(i)} for i in range(1, n + 1)]
    return [Candidate(effect.name, values, discrete=True) for values in changes]


def do_change(vehicle: Vehicle, changes: Sequence[tuple[str, dict[str, float]]]) -> list[bool]:
    """Whether each change, values of an effect, makes another vehicle at all."""
    does = np.zeros(len(changes), bool)
    for name in {name for name, _ in changes}:  # all of an effect at once: one by one takes many times as long
        rows = [i for i, (effect, _) in enumerate(changes) if effect == name]
        changed = batch(vehicle, [{name: changes[i][1]} for i in rows])
        for key, value in vehicle.items():
            does[rows] |= (changed.get(key) != value).reshape(len(rows), -1).any(-1)
    return does.tolist()


def nuisance_parameters(vehicle: Vehicle, settings: Settings, channels: Collection[str] = ()) -> list[Entry]:
    """What no vehicle has exactly as modelled.

    A coefficient of 0 has no relative nuisance parameters, and a scale of it changes nothing: both are left out. What
    sound sensors are off by is nuisance parameters where a log has the ``channels`` that show it.
    """
    found: list[Entry] = []
    for name, effect in EFFECTS.items():
        if not effect.trial.is_asked(channels):
            continue
        widths = settings.nuisance_of(effect)
        for member, p in effect.member_parameters(vehicle).items():
            nominal = p.nominal_value(vehicle, member)
            loose = p.loose_in(channels)
            if widths or loose:
                found.append((name, member, nominal, widths.get(p.name, 0.0) * abs(nominal) or loose))
    return that_matter(vehicle, found)


def that_matter(vehicle: Vehicle, entries: Sequence[Entry]) -> list[Entry]:
    """Those parameters that make another vehicle where they are off by their width."""
    acts = do_change(vehicle, [(name, {member: nominal + width}) for name, member, nominal, width in entries])
    return [entry for entry, does in zip(entries, acts, strict=True) if does]


def sensor_nuisance(vehicle: Vehicle, settings: Settings, channels: Collection[str]) -> list[Entry]:
    """That of the nuisance parameters which sound sensors are off by in logs with these ``channels``."""
    found = nuisance_parameters(vehicle, settings, channels)
    return [entry for entry in found if declared(entry[0], vehicle).parameters[entry[1]].loose_in(channels)]
