"""An explanation of a log: some effects with values, and the slack of every coefficient."""

from dataclasses import dataclass, field, replace

from auv_torchrl.diagnosis.identify.declared import declared
from auv_torchrl.diagnosis.identify.hypotheses import Atom, Values
from auv_torchrl.vehicle import Vehicle


@dataclass(frozen=True)
class Knob:
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
    """Knobs away from nominal, and small deviations of the slack parameters, added on top."""

    knobs: tuple[Knob, ...] = ()
    slack: dict[tuple[str, str], float] = field(default_factory=dict)  # (effect, parameter) -> deviation

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects in it, in the order in which they were added."""
        return tuple(dict.fromkeys(knob.effect for knob in self.knobs))

    @property
    def alone(self) -> "Explanation":
        """The effects without slack."""
        return replace(self, slack={})

    @property
    def fitted(self) -> tuple[Knob, ...]:
        """The knobs with a continuous value."""
        return tuple(knob for knob in self.knobs if not knob.discrete)

    @property
    def members(self) -> set[tuple[str, str]]:
        """What knobs set, as (effect, parameter)."""
        return {(knob.effect, member) for knob in self.knobs for member in knob.members}

    def values(self, vehicle: Vehicle, slack: bool = True) -> Values:
        """Parameter values by effect, slack added unless told otherwise."""
        values: Values = {}
        names = {knob.effect for knob in self.knobs} | {effect for effect, _ in self.slack}
        known = {name: declared(name, vehicle) for name in names}
        for knob in self.knobs:
            parameters, nominal, _ = known[knob.effect]
            row = values.setdefault(knob.effect, {})
            for member in knob.members:
                if knob.discrete or member not in row:
                    row[member] = knob.value
                else:  # two knobs within bounds can add up to an inertia of nothing
                    both = row[member] + knob.value - nominal[member]
                    row[member] = min(max(both, parameters[member].low), parameters[member].high)
        if slack:
            told = self.members
            for (effect, member), deviation in self.slack.items():
                row, (parameters, nominal, _) = values.setdefault(effect, {}), known[effect]
                p = parameters[member]
                if p.loose and (effect, member) in told:
                    continue  # an offset is one number: the effect that has a value for it says all of it
                row[member] = min(max(row.get(member, nominal[member]) + deviation, p.low), p.high)
        return values

    def moved(self, amounts: dict[int, float]) -> "Explanation":
        """The explanation with other values of some knobs, by their place."""
        knobs = [replace(k, value=amounts[i]) if i in amounts else k for i, k in enumerate(self.knobs)]
        return replace(self, knobs=tuple(knobs))

    def starting_from(self, other: "Explanation") -> "Explanation":
        """The explanation with the slack of another one, and its values of the knobs that both have."""
        known = {knob.key: knob for knob in other.knobs}
        return Explanation(tuple(known.get(knob.key, knob) for knob in self.knobs), other.slack)

    def without(self, effect: str) -> "Explanation":
        """The explanation less one effect."""
        return replace(self, knobs=tuple(knob for knob in self.knobs if knob.effect != effect))

    def with_atom(self, atom: Atom, vehicle: Vehicle, amount: float = 1.0) -> "Explanation":
        """The explanation with one more change; a knob that is there already is moved on."""
        parameters, nominal, _ = declared(atom.effect, vehicle)
        groups: dict[str, list[str]] = {}
        for member in atom.values:
            groups.setdefault(parameters[member].name if not atom.discrete else member, []).append(member)
        knobs = list(self.knobs)
        for members in groups.values():
            p = parameters[members[0]]
            start = nominal[members[0]]
            value = atom.values[members[0]]
            if not atom.discrete:
                value = min(max(start + amount * (value - start), p.low), p.high)
            fresh = Knob(atom.effect, tuple(members), value, atom.discrete)
            known = next((i for i, knob in enumerate(knobs) if knob.key == fresh.key), None)
            if known is None:
                knobs.append(fresh)
            elif atom.discrete:
                knobs[known] = fresh
            else:
                moved = min(max(knobs[known].value + fresh.value - start, p.low), p.high)
                knobs[known] = replace(fresh, value=moved)
        return replace(self, knobs=tuple(knobs))
