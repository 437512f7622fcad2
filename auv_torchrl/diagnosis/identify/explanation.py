"""An explanation of a log: effects with values, deviations of nuisance parameters, and what their freedom costs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import comb, e, factorial, log, pi

import numpy as np

from auv_torchrl.diagnosis.identify.hypotheses import Candidate, Values, declared
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import ONE_MORE_VALUE, RANGE_CAP, SECOND_EFFECT, WORTH_AN_EFFECT
from auv_torchrl.effects import EFFECTS, Parameter
from auv_torchrl.vehicle import Vehicle


@dataclass(frozen=True)
class Term:
    """Parameters of one effect that share one value; a discrete one is not fitted."""

    effect: str
    members: tuple[str, ...]
    value: float
    discrete: bool = False

    @property
    def key(self) -> tuple[str, tuple[str, ...]]:
        """What it is, whatever its value."""
        return self.effect, self.members


@dataclass(frozen=True)
class Explanation:
    """Terms away from nominal, and small deviations of the nuisance parameters, added on top."""

    terms: tuple[Term, ...] = ()
    nuisance: dict[tuple[str, str], float] = field(default_factory=dict)  # (effect, parameter) -> deviation

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects in it, in the order in which they were added."""
        return tuple(dict.fromkeys(term.effect for term in self.terms))

    @property
    def alone(self) -> "Explanation":
        """The effects without nuisance parameters."""
        return replace(self, nuisance={})

    @property
    def fitted(self) -> tuple[Term, ...]:
        """The terms with a continuous value."""
        return tuple(term for term in self.terms if not term.discrete)

    @property
    def members(self) -> set[tuple[str, str]]:
        """What terms set, as (effect, parameter)."""
        return {(term.effect, member) for term in self.terms for member in term.members}

    def values(self, vehicle: Vehicle, nuisance: bool = True) -> Values:
        """Parameter values by effect, nuisance parameters added where ``nuisance`` says so."""
        values: Values = {}
        names = {term.effect for term in self.terms} | {effect for effect, _ in self.nuisance}
        known = {name: declared(name, vehicle) for name in names}
        for term in self.terms:
            parameters, nominal, _ = known[term.effect]
            row = values.setdefault(term.effect, {})
            for member in term.members:
                if term.discrete or member not in row:
                    row[member] = term.value
                else:  # two terms within bounds can add up to an inertia of nothing
                    both = row[member] + term.value - nominal[member]
                    row[member] = min(max(both, parameters[member].low), parameters[member].high)
        if nuisance:
            have_value = self.members
            for (effect, member), deviation in self.nuisance.items():
                row, (parameters, nominal, _) = values.setdefault(effect, {}), known[effect]
                p = parameters[member]
                if p.loose and (effect, member) in have_value:
                    continue  # an offset is one number: the effect that has a value for it says all of it
                row[member] = min(max(row.get(member, nominal[member]) + deviation, p.low), p.high)
        return values

    def moved(self, amounts: dict[int, float]) -> "Explanation":
        """The explanation with other values of some terms, by their place."""
        terms = [replace(k, value=amounts[i]) if i in amounts else k for i, k in enumerate(self.terms)]
        return replace(self, terms=tuple(terms))

    def without(self, effect: str) -> "Explanation":
        """The explanation less one effect."""
        return replace(self, terms=tuple(term for term in self.terms if term.effect != effect))

    def with_candidate(self, candidate: Candidate, vehicle: Vehicle, amount: float = 1.0) -> "Explanation":
        """The explanation with one more change; a term that is there already is moved on."""
        parameters, nominal, _ = declared(candidate.effect, vehicle)
        groups: dict[str, list[str]] = {}
        for member in candidate.values:
            groups.setdefault(parameters[member].name if not candidate.discrete else member, []).append(member)
        terms = list(self.terms)
        for members in groups.values():
            p = parameters[members[0]]
            start = nominal[members[0]]
            value = candidate.values[members[0]]
            if not candidate.discrete:
                value = min(max(start + amount * (value - start), p.low), p.high)
            fresh = Term(candidate.effect, tuple(members), value, candidate.discrete)
            known = next((i for i, term in enumerate(terms) if term.key == fresh.key), None)
            if known is None:
                terms.append(fresh)
            elif candidate.discrete:
                terms[known] = fresh
            else:
                moved = min(max(terms[known].value + fresh.value - start, p.low), p.high)
                terms[known] = replace(fresh, value=moved)
        return replace(self, terms=tuple(terms))


@dataclass(frozen=True)
class Prior:
    """Prior over structures and values for one vehicle."""

    vehicle: Vehicle
    families: int  # effects that are tried
    none: float

    def width(self, effect: str, member: str) -> float:
        """Plausible range of a parameter, in its unit."""
        return plausible_range(declared(effect, self.vehicle).parameters[member])

    def structure(self, explanation: Explanation) -> float:
        """Log prior probability of having exactly these terms."""
        effects = explanation.effects
        if not effects:
            return log(self.none)
        total = log((1 - self.none) / self.families)
        total += (len(effects) - 1) * log(SECOND_EFFECT)
        for effect in effects:
            total += log(EFFECTS[effect].trial.odds)
            members = len(declared(effect, self.vehicle).parameters)
            terms = [term for term in explanation.terms if term.effect == effect]
            if terms[0].discrete:
                total += _log_prior_of_plugs(giver_of(terms), sum(term.value < 0 for term in terms), members)
                continue
            total += (len(terms) - 1) * log(ONE_MORE_VALUE)
            if members > 1:
                total -= log(members) + log(comb(members, min(len(terms), members)))  # how many, then which
        return total


def _log_prior_of_plugs(giver: Mapping[int, int], opposite: int, thrusters: int) -> float:
    """Of whose command each thruster gets, and that some of them get the opposite."""
    moved = sum(receiver != its for receiver, its in giver.items())
    others = [ring for ring in rings(giver) if len(ring) > 1]
    total = (exchanges(giver) + opposite - 1) * log(ONE_MORE_VALUE)
    total -= (len(others) + (opposite > 0) - 1) * WORTH_AN_EFFECT  # a ring of plugs is a mishap of its own
    if others:
        total -= log(comb(thrusters, min(moved, thrusters)) * max(1, derangements(moved)))
    if opposite:
        total -= log(thrusters) + log(comb(thrusters, min(opposite, thrusters)))  # how many, then which
    return total


def giver_of(terms: Sequence[Term]) -> dict[int, int]:
    """By number of a thruster, whose command it gets under discrete terms, or the opposite of whose."""
    return {int(term.members[0].rsplit("_", 1)[1]): round(abs(term.value)) for term in terms}


def exchanges(giver: Mapping[int, int]) -> int:
    """How many exchanges of two plugs make a permutation: one less than its length for each ring."""
    return sum(len(ring) - 1 for ring in rings(giver))


def rings(giver: Mapping[int, int]) -> list[tuple[int, ...]]:
    """The rings along which commands are passed on; what no ring closes hangs together all the same."""
    found: list[set[int]] = []
    for receiver, its in giver.items():
        meets = [ring for ring in found if ring & {receiver, its}]
        found = [ring for ring in found if ring not in meets] + [{receiver, its}.union(*meets)]
    return [tuple(sorted(ring)) for ring in found]


def derangements(count: int) -> int:
    """In how many ways so many plugs can all sit elsewhere."""
    return round(factorial(count) / e)


def plausible_range(p: Parameter) -> float:
    """How far apart values of a parameter may plausibly be, in its unit."""
    return min(p.high - p.low, RANGE_CAP.get(p.unit, np.inf))


def volume(curvature: Floats, widths: Floats) -> float:
    """Log of the share of the prior range of the values that the log leaves open.

    Args:
        curvature: (k, k) half the Hessian of chi-square in the values, in their units.
        widths: (k,) prior range of each.
    """
    if not len(widths):
        return 0.0
    scaled = np.linalg.eigvalsh(curvature * np.outer(widths, widths))
    seen = np.maximum(scaled, 2 * pi)  # a direction that the log does not see costs nothing
    return float(0.5 * (log(2 * pi) - np.log(seen)).sum())
