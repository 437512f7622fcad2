"""What a fit or a diagnosis says of a log, against what was flown: one measure for all."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from auv_torchrl.effects import get_effect
from auv_torchrl.vehicle import Vehicle
from benchmarks.blind.scores.judge import judge
from benchmarks.versus.parameters import SAME, size_of

MOVED = 0.05  # of the size of a number, from which on it counts as moved
_AS_FREE = {other: name for name, others in SAME.items() for other in others}


@dataclass(frozen=True)
class Outcome:
    """One answer to one log."""

    case: str
    family: str
    truth: str
    first: str  # what it says first
    found: bool | None  # by the largest departure; None where it has no such answer
    found_unsure: bool | None  # by the largest departure, whatever its interval says
    errors: tuple[float, ...]  # of the true numbers of each effect, over its size
    covered: tuple[bool, ...]  # whether intervals hold the true numbers
    moved: int  # sound numbers that moved
    free: int  # numbers that could
    cpu_s: float
    before_m: float
    after_m: float


def judge_fit(name: str, label: Mapping[str, Any], answer: Mapping[str, Any], vehicle: Vehicle) -> Outcome:
    """The outcome of a fit of all numbers at once."""
    numbers = answer["numbers"]
    significant = [n for n in numbers if n["half"] is not None and abs(n["value"] - n["nominal"]) > n["half"]]
    every, largest = (sorted(own, key=_departure, reverse=True) for own in (numbers, significant))
    effects = label["effects"]
    sound = [n for n in numbers if not set(n["causes"]) & set(effects)]
    halves = {n["name"]: math.inf if n["half"] is None else n["half"] for n in numbers}
    ends = {n["name"]: (n["value"], n["value"] - halves[n["name"]], n["value"] + halves[n["name"]]) for n in numbers}
    errors, covered = _against(label["values"], ends, {n["name"] for n in numbers}, vehicle)
    return Outcome(
        case=name,
        family=label["family"],
        truth=truth_of(label),
        first=_said(largest or every),
        found=_is_found(label, largest),
        found_unsure=_is_found(label, every),
        errors=errors,
        covered=covered,
        moved=sum(_departs(n) for n in sound),
        free=len(numbers),
        cpu_s=answer["cpu_s"],
        before_m=answer["before_m"],
        after_m=answer["after_m"],
    )


def judge_ours(
    name: str, label: Mapping[str, Any], answer: Mapping[str, Any], held: tuple[float, float], vehicle: Vehicle
) -> Outcome:
    """The outcome of a diagnosis, with the errors in m of held-out flight before and after."""
    own = judge(name, label, answer, vehicle)
    named = answer.get("diagnosis", {}).get("effects", [])
    ends, moved = {}, 0
    for effect in named:
        for member, value in effect["parameters"].items():
            full = f"{effect['name']}.{member}"
            ends[full] = (value["value"], *_interval(value))
            size = size_of(full, value["nominal"])
            moved += effect["name"] not in label["effects"] and abs(value["value"] - value["nominal"]) > MOVED * size
    return Outcome(
        case=name,
        family=label["family"],
        truth=truth_of(label),
        first=own.answered,
        found=own.right_class,
        found_unsure=own.right_class,
        errors=_against(label["values"], ends, None, vehicle)[0],
        covered=tuple(own.covered.values()),
        moved=moved,
        free=0,
        cpu_s=own.cpu_s,
        before_m=held[0],
        after_m=held[1],
    )


def truth_of(label: Mapping[str, Any]) -> str:
    """What was flown, in words."""
    return label["outside"] or " + ".join(label["effects"]) or "nothing"


def values_of(answer: Mapping[str, Any]) -> dict[str, float]:
    """The numbers of an answer of the diagnosis, by ``effect.parameter``."""
    named = answer.get("diagnosis", {}).get("effects", [])
    return {f"{e['name']}.{member}": value["value"] for e in named for member, value in e["parameters"].items()}


def _interval(value: Mapping[str, Any]) -> tuple[float, float]:
    low, high = value["low"], value["high"]
    return -math.inf if low is None else low, math.inf if high is None else high


def _is_found(label: Mapping[str, Any], ranked: Sequence[Mapping[str, Any]]) -> bool | None:
    """Whether the first departures are those of the causes; None where no number stands for what acts."""
    effects = label["effects"]
    if label["outside"]:
        return None
    if not effects:
        return not any(map(_departs, ranked))
    told = [set(causes) for _, causes in _in_order(ranked)][: len(effects)]
    return len(told) == len(effects) and _is_matching(list(effects), told)


def _in_order(ranked: Iterable[Mapping[str, Any]]) -> list[tuple[str, Sequence[str]]]:
    """The effects of ranked numbers, each once, where it comes first."""
    seen: dict[str, Sequence[str]] = {}
    for number in ranked:
        seen.setdefault(_effect(number), number["causes"])
    return list(seen.items())


def _is_matching(effects: list[str], told: list[set[str]]) -> bool:
    """Whether each effect is among the causes of a number of its own."""
    if not effects:
        return True
    rest = effects[1:]
    return any(effects[0] in causes and _is_matching(rest, told[:i] + told[i + 1 :]) for i, causes in enumerate(told))


def _against(
    truth: Mapping[str, Mapping[str, float]],
    ends: Mapping[str, tuple[float, float, float]],
    free: set[str] | None,
    vehicle: Vehicle,
) -> tuple[tuple[float, ...], tuple[bool, ...]]:
    """Errors over sizes by effect, and whether intervals hold the truth.

    Effects that a model has no number for have no error; what a diagnosis (``free`` is None) does not name stays
    nominal, and is wrong by all of its size.
    """
    errors: list[float] = []
    covered: list[bool] = []
    for effect, values in truth.items():
        declared, nominal = get_effect(effect).member_parameters(vehicle), get_effect(effect).nominal(vehicle)
        own = effect if free is None else _AS_FREE.get(effect, effect)
        members = [m for m, p in declared.items() if not p.discrete and (free is None or f"{own}.{m}" in free)]
        for unit in dict.fromkeys(declared[m].unit for m in members):
            true = {m: values.get(m, nominal[m]) for m in members if declared[m].unit == unit}
            got = {m: ends[f"{own}.{m}"] for m in true if f"{own}.{m}" in ends}
            size = math.hypot(*(true[m] - nominal[m] for m in true))
            if size > 0:
                found = {m: got[m][0] if m in got else nominal[m] for m in true}
                errors.append(math.hypot(*(found[m] - true[m] for m in true)) / size)
                covered += [low <= true[m] <= high for m, (_, low, high) in got.items() if true[m] != nominal[m]]
    return tuple(errors), tuple(covered)


def _departs(number: Mapping[str, Any]) -> bool:
    return _departure(number) > MOVED


def _departure(number: Mapping[str, Any]) -> float:
    return abs(number["value"] - number["nominal"]) / number["size"]


def _effect(number: Mapping[str, Any]) -> str:
    return str(number["name"]).partition(".")[0]


def _said(ranked: Sequence[Mapping[str, Any]]) -> str:
    return ", ".join(f"{n['name']} {n['value']:.3g}" for n in ranked[:2]) or "nothing"
