"""An explanation of a log: some effects with values, and deviations of the nuisance parameters."""

from dataclasses import dataclass, field, replace

from auv_torchrl.diagnosis.identify.declared import declared
from auv_torchrl.diagnosis.identify.hypotheses import Candidate, Values
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
        """Parameter values by effect, nuisance parameters added unless told otherwise."""
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
            told = self.members
            for (effect, member), deviation in self.nuisance.items():
                row, (parameters, nominal, _) = values.setdefault(effect, {}), known[effect]
                p = parameters[member]
                if p.loose and (effect, member) in told:
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
