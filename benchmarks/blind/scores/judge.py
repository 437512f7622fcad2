"""One answer against one truth."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from auv_torchrl.effects import get_effect
from auv_torchrl.vehicle import Vehicle
from benchmarks.blind.flights.strangers import as_flown, with_changes
from benchmarks.blind.scores.judge_damage import Named, judge_damage
from benchmarks.blind.scores.thrusters import declared_groups, same_class, thrusters_right
from benchmarks.scoring import Score, fault, score_diagnosis, sound, unknown

NOT_EXPLAINED = ("partly_explained", "unexplained", "cannot_tell")
NO_MARK = " would leave no mark on this log"  # the end of a sentence under cannot_tell
STANDS_FOR = {  # with the effect left out of the library, these say the same about any log
    "command_delay": {"pose_delay"},
    "pose_delay": {"command_delay"},
    "buoyancy": {"payload"},
    "payload": {"buoyancy", "added_mass", "mass_offset"},
}


@dataclass(frozen=True)
class Judgement:
    """What the scoring reads about one case."""

    case: str
    family: str
    plant: str
    truth: str
    effects: tuple[str, ...]
    outside: str | None
    left_out: str | None
    scale: float
    seconds_of_log: float
    noise: float
    influence: float | None  # of the effect that shows least
    answer: str  # first effect named, "no_gap", "unknown" or "error"
    named: tuple[str, ...]  # all effects of the explanation
    verdict: str
    right: bool  # answer is the truth; for what the library lacks: said to be not (fully) explained
    right_class: bool  # or declared indistinguishable from it, or unseen, or the same thing under another name
    thrusters_right: bool | None  # None where the effect is not of single thrusters
    probability: float | None  # of the answer, or of its declared class
    probability_of_truth: float | None  # likewise
    closed: float | None
    onset_error_s: float | None
    seconds: float
    cpu_s: float
    errors: dict[str, float] = field(default_factory=dict)  # parameter error over the effect's size, by unit
    covered: dict[str, bool] = field(default_factory=dict)  # whether the 95 % interval holds the truth
    message: str = ""
    damage: str | None = None  # of the log
    damage_named: bool | None = None  # None in the families without damage, as the next two
    wrong_causes: tuple[str, ...] | None = None  # effects held for more likely than not that are neither
    fault_found: bool | None = None  # beside the damage; None also where the rest of the log does not show it
    fault: str | None = None  # of a vehicle with a set of sensors
    sizes: dict[str, float] = field(default_factory=dict)  # by effect, the smallest that a log without a gap would show
    stranger: int | None = None  # number of the vehicle, where it is a stranger
    unseen: tuple[str, ...] = ()  # effects that it said would leave no mark on the log
    score: str = Score.WRONG.name.lower()  # by the rule of benchmarks.scoring

    @property
    def answered(self) -> str:
        """All that is named, or the verdict."""
        return " + ".join(self.named) or self.verdict


def judge(name: str, label: Mapping[str, Any], answer: Mapping[str, Any], vehicle: Vehicle) -> Judgement:
    """Compare the answer to a case with its label; what is found on a stranger counts from what it is."""
    vehicle = with_changes(vehicle, label.get("base", ()))
    silent = {"verdict": "refused" if "refused" in answer else "error", "effects": [], "candidates": [], "gap": {}}
    diagnosis = answer.get("diagnosis") or silent
    verdict, named = diagnosis["verdict"], tuple(effect["name"] for effect in diagnosis["effects"])
    first = named[0] if named else {"no_gap": "no_gap", "error": "error", "refused": "error"}.get(verdict, "unknown")
    truth, effects = label["truth"], tuple(label["effects"])
    declared = declared_groups(diagnosis)
    beside = judge_damage(label, diagnosis, answer.get("refused", ""), vehicle) if label.get("damage") else Named()
    right, right_class = _rightness(label, verdict, named, first, declared, beside)
    no_mark = bool(label.get("fault") and truth in _unseen(diagnosis) and not named)
    errors, covered = _parameters({} if label["family"] == "onset" else as_flown(label), diagnosis["effects"], vehicle)
    groups = declared if len(effects) == 1 and len(named) == 1 else []  # declared indistinguishable: one answer
    return Judgement(
        case=name,
        family=label["family"],
        plant=label["plant"],
        truth=truth,
        effects=effects,
        outside=label["outside"],
        left_out=label["left_out"],
        scale=label["scale"],
        seconds_of_log=label["episodes"] * label["episode_s"],
        noise=label["noise"],
        influence=min(label["influence"].values(), default=None),
        answer="unknown" if truth == "unknown" and right else first,
        named=named,
        verdict=verdict,
        right=right,
        right_class=right_class or no_mark,
        thrusters_right=thrusters_right(label, diagnosis["effects"], declared, vehicle),
        probability=_probability(first, diagnosis, groups),
        probability_of_truth=_probability(truth, diagnosis, groups),
        closed=diagnosis["gap"].get("closed"),
        onset_error_s=_onset_error(label["onset_s"], (diagnosis.get("where") or {}).get("onset_s")),
        seconds=answer["seconds"],
        cpu_s=answer["cpu_s"],
        errors=errors,
        covered=covered,
        message=answer.get("error", answer.get("refused", "")),
        damage=label.get("damage"),
        damage_named=beside.damage,
        wrong_causes=beside.wrong,
        fault_found=beside.fault,
        fault=label.get("fault"),
        sizes=_sizes(diagnosis.get("detectable", {})),
        stranger=label.get("stranger"),
        unseen=_unseen(diagnosis),
        score=_score(label, diagnosis, vehicle, beside.score, no_mark, right_class).name.lower(),
    )


def _score(
    label: Mapping[str, Any],
    diagnosis: Mapping[str, Any],
    vehicle: Vehicle,
    damaged: Score,
    no_mark: bool,
    right_class: bool,
) -> Score:
    """The score of an answer; ``damaged`` is that of a damaged log; ``no_mark``: no log of these sensors shows it."""
    if label.get("damage"):
        return damaged
    if no_mark:
        return score_diagnosis(diagnosis, sound(), vehicle)
    if label["truth"] == "unknown":
        given = score_diagnosis(diagnosis, unknown(), vehicle)
        return Score.HALF if given is Score.WRONG and right_class else given  # by another name of the same thing
    values = as_flown(label)
    return score_diagnosis(diagnosis, fault(values, label["onset_s"]) if values else sound(), vehicle)


def _rightness(
    label: Mapping[str, Any], verdict: str, named: tuple[str, ...], first: str, declared: list[list[str]], beside: Named
) -> tuple[bool, bool]:
    """Whether an answer is right, and whether it is so up to what it declared or what says the same."""
    truth, effects = label["truth"], tuple(label["effects"])
    if label.get("damage"):
        right = bool(beside.damage) and not beside.wrong and beside.fault is not False
        return right, right
    if truth == "unknown":
        right = verdict in NOT_EXPLAINED
        return right, right or (bool(named) and set(named) <= STANDS_FOR.get(label["left_out"], set()))
    if len(effects) > 1:
        right = set(named) == set(effects)
        return right, right or _same_sets(effects, named, declared)
    return first == truth, first == truth or _same_sets((truth,), (first,), declared)


def _unseen(diagnosis: Mapping[str, Any]) -> tuple[str, ...]:
    """Effects that it says would leave no mark on the log."""
    return tuple(s.removesuffix(NO_MARK) for s in diagnosis.get("cannot_tell", ()) if s.endswith(NO_MARK))


def _onset_error(true: float | None, found: float | None) -> float | None:
    """Seconds between them; None where one of them is no onset."""
    return None if true is None or found is None else abs(found - true)


def _sizes(detectable: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """By effect, how far from nominal it would have to be to show."""
    return {name: abs(size["value"] - size["nominal"]) for name, size in detectable.items()}


def _same_sets(truth: tuple[str, ...], named: tuple[str, ...], declared: list[list[str]]) -> bool:
    """Whether the answer names the truth up to what it declared indistinguishable."""
    if len(truth) != len(named):
        return False
    left = list(truth)
    for effect in named:
        allowed = same_class(effect, declared)
        match = next((t for t in left if t in allowed), None)
        if match is None:
            return False
        left.remove(match)
    return True


def _probability(answer: str, diagnosis: Mapping[str, Any], groups: list[list[str]]) -> float | None:
    """Probability of an answer with those of its groups: among the candidates, or in an explanation by several."""
    candidates = {c["name"]: c["probability"] for c in diagnosis["candidates"]}
    explanation = {effect["name"]: effect["probability"] for effect in diagnosis["effects"]}
    if answer == "no_gap":
        own = candidates.get("none", candidates.get("no_gap"))
    elif len(explanation) > 1 and answer in explanation:
        own = explanation[answer]
    elif answer in candidates:
        own = candidates[answer]
    else:
        own = 0.0 if candidates and diagnosis["verdict"] not in ("error", "refused") else None
    if own is None or not groups:
        return own
    return max(own, min(1.0, sum(candidates.get(name, 0.0) for name in same_class(answer, groups))))


def _parameters(
    truth: Mapping[str, Mapping[str, float]], found: list[dict[str, Any]], vehicle: Vehicle
) -> tuple[dict[str, float], dict[str, bool]]:
    """Errors over sizes by effect and unit, and what the intervals hold, for effects that were named rightly.

    One value of all members of a family is one number with one interval, and counts once.
    """
    errors, covered = {}, {}
    for effect, values in truth.items():
        answer = next((f["parameters"] for f in found if f["name"] == effect), None)
        if answer is None:
            continue
        declared, nominal = get_effect(effect).member_parameters(vehicle), get_effect(effect).nominal(vehicle)
        for unit in dict.fromkeys(p.unit for p in declared.values() if not p.discrete):
            members = [k for k, p in declared.items() if p.unit == unit and not p.discrete]
            true = {k: values.get(k, nominal[k]) for k in members}
            size = math.hypot(*(true[k] - nominal[k] for k in members))
            if size > 0:
                answered = {k: answer[k]["value"] if k in answer else nominal[k] for k in members}
                errors[f"{effect} [{unit}]"] = math.hypot(*(answered[k] - true[k] for k in members)) / size
            intervals = {(answer[k]["low"], answer[k]["high"], true[k]): k for k in reversed(members) if k in answer}
            covered |= {f"{effect}.{k}": low <= value <= high for (low, high, value), k in intervals.items()}
    return errors, covered
