"""When an answer of the diagnosis is right: one rule for every benchmark.

An answer is compared with what was flown: which verdict the case calls for, which effects act, on which thrusters, with
which values, and from when on. Only names that are likelier than not count as claims; what corrects the vehicle's file
(``calibrates``) is no claim about a fault. Two names that an answer declares indistinguishable leave its reader with
two things to look at: such an answer is half right, never right.
"""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

from auv_torchrl.diagnosis.identify.hypotheses import plainer_names
from auv_torchrl.effects import EFFECTS, get_effect
from auv_torchrl.effects.effect import Parameter
from auv_torchrl.vehicle import Vehicle
from benchmarks.blind.scores.thrusters import declared_groups, exchangeable, same_class

LIKELY = 0.5  # probability above which a name is a claim
NEAR = 0.2  # of its departure from nominal, that a value may be off by
LEAST = 0.5  # of the largest departure of the same unit, that a smaller departure counts as: a current due north, east
ONSET_S = 2.0  # that the moment may be off by: a window of the diagnosis

Values = Mapping[str, Mapping[str, float]]  # by effect, its parameters


class Score(Enum):
    """How right an answer is; the value is the sentence for people."""

    RIGHT = (
        "The verdict is the one that the case calls for, and the names that are likelier than not are those of the "
        "true causes and no others, each on its thrusters, near its value, and from its moment on."
    )
    HALF = (
        "Every true cause is named on its thrusters, or was declared indistinguishable from a name, but the verdict, a "
        "probability, a value or the moment is not right, or something is named beside it. Where nothing of the "
        "library acts, the verdict is right, and something is named all the same."
    )
    WRONG = "A true cause is missing, or a sound vehicle is called faulty."

    @property
    def cells(self) -> tuple[str, str]:
        """The columns *right* and *half right* of a table."""
        return ("yes" if self is Score.RIGHT else "no"), ("yes" if self is Score.HALF else "")


@dataclass(frozen=True)
class Truth:
    """What an answer should say."""

    verdicts: frozenset[str]  # any of these
    values: Values = field(default_factory=dict)  # of the effects that act; none: nothing of the library does
    onset_s: float | None = None  # None: always


@dataclass(frozen=True)
class Named:
    """One name of an answer."""

    probability: float
    stands_for: frozenset[str]  # true causes that it names, itself or by what was declared
    is_exact: bool  # it is such a cause, on its thrusters and near its value


def sound() -> Truth:
    """What to say of a vehicle that is as it should be."""
    return Truth(frozenset(("no_gap",)))


def fault(values: Values, onset_s: float | None = None) -> Truth:
    """What to say of a vehicle with effects that the library has."""
    return Truth(frozenset(("explained",)), values, onset_s)


def unknown() -> Truth:
    """What to say of a vehicle with an effect that the library lacks."""
    return Truth(frozenset(("partly_explained", "unexplained", "cannot_tell")))


def score_diagnosis(diagnosis: Mapping[str, Any], truth: Truth, vehicle: Vehicle, likely: float = LIKELY) -> Score:
    """Score an answer.

    Args:
        diagnosis: as in ``diagnosis.json``.
        truth: what it should say.
        vehicle: that was flown, without the effects.
        likely: probability above which a name is a claim.
    """
    declared = declared_groups(diagnosis)
    named = [_named(plainly(effect, vehicle), truth.values, declared, vehicle) for effect in diagnosis["effects"]]
    claims = [one for one, effect in zip(named, diagnosis["effects"], strict=True) if not effect.get("calibrates")]
    timely = is_timely((diagnosis.get("where") or {}).get("onset_s"), truth.onset_s)
    return score(diagnosis["verdict"] in truth.verdicts, truth.values, claims, timely, likely)


def score(
    verdict_fits: bool, causes: Collection[str], named: Iterable[Named], timely: bool = True, likely: float = LIKELY
) -> Score:
    """Score the names of an answer whose verdict is, or is not, the one that the case calls for."""
    named = list(named)
    claims = [one for one in named if one.probability > likely]
    exact = all(one.is_exact for one in claims)
    claimed = frozenset[str]().union(*(one.stands_for for one in claims))
    if verdict_fits and timely and exact and claimed == set(causes):
        return Score.RIGHT
    there = frozenset[str]().union(*(one.stands_for for one in named))
    return Score.HALF if (set(causes) <= there if causes else verdict_fits) else Score.WRONG


def is_timely(found: float | None, true: float | None) -> bool:
    """Whether the moment is right: none where the cause always acts."""
    return found is None if true is None else found is not None and abs(found - true) <= ONSET_S


def is_near(
    effect: str, truth: Mapping[str, float], found: Mapping[str, Mapping[str, float]], vehicle: Vehicle
) -> bool:
    """Whether the values of an effect are near the true ones.

    Numbers of a discrete parameter are the same. A unit of which the truth has nothing, as the place of a load that
    sits in the middle, has no size that a value could be near to.
    """
    declared, nominal = get_effect(effect).member_parameters(vehicle), get_effect(effect).nominal(vehicle)
    by_unit: dict[str, list[tuple[float, float]]] = {}  # departures from nominal, and errors
    for member in {*truth, *found}:
        own = found.get(member)
        at = own["nominal"] if own else nominal[member]
        true = truth.get(member, at)
        error = (own["value"] if own else at) - true
        if declared[member].discrete and error:
            return False
        by_unit.setdefault(declared[member].unit, []).append((true - at, error))
    for numbers in by_unit.values():
        largest = max(abs(departure) for departure, _ in numbers)
        if largest and any(abs(e) > NEAR * max(abs(d), LEAST * largest) for d, e in numbers):
            return False
    return True


def plainly(effect: Mapping[str, Any], vehicle: Vehicle) -> Mapping[str, Any]:
    """An effect of an answer by its plainer name, where it is the same thing on the vehicle that was flown.

    A propeller that turns the wrong way has a gain of -1 where it pushes as hard both ways, whatever the file says.
    """
    away = [(member, p["value"]) for member, p in effect["parameters"].items() if p["value"] != p["nominal"]]
    same = plainer_names(get_effect(effect["name"]), vehicle, away, EFFECTS) if away else None
    names = {one[0] for one in same or ()}
    if same is None or len(names) != 1:
        return effect
    (name,) = names
    nominal = get_effect(name).nominal(vehicle)
    parameters = {member: {"value": value, "nominal": nominal[member]} for _, member, value in same}
    return {**effect, "name": name, "parameters": parameters}


def _named(effect: Mapping[str, Any], truth: Values, declared: list[list[str]], vehicle: Vehicle) -> Named:
    name, found = effect["name"], effect["parameters"]
    others = (same_class(name, declared) - {name}) & set(truth)
    if name not in truth:
        return Named(effect["probability"], frozenset(others), is_exact=False)
    members, nominal = get_effect(name).member_parameters(vehicle), get_effect(name).nominal(vehicle)
    wanted = _thrusters(members, {k: v for k, v in truth[name].items() if v != nominal[k]})
    at = _thrusters(members, {k: p["value"] for k, p in found.items() if p["value"] != p["nominal"]})
    swapped = any(wanted <= those for those in exchangeable(name, at, declared, vehicle))
    own = frozenset((name,)) if wanted <= at or swapped else frozenset[str]()
    return Named(effect["probability"], own | others, wanted == at and is_near(name, truth[name], found, vehicle))


def _thrusters(members: Mapping[str, Parameter], changed: Iterable[str]) -> frozenset[int]:
    return frozenset(int(k.rsplit("_", 1)[1]) for k in changed if members[k].over == "thruster")
