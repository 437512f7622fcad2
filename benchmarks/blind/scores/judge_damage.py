"""One answer about a damaged log: does it name the damage, does it blame what is sound, does it find the fault?"""

import re
from collections.abc import Mapping
from typing import Any, NamedTuple

from auv_torchrl.vehicle import Vehicle
from benchmarks import scoring
from benchmarks.blind.scores.thrusters import declared_groups, same_class, split_entry, thrusters_right

REFUSALS = {  # in the sentence with which a log is refused, by what would be the code of a finding
    "constant_column": r"never chang|constant|stands? still",
    "frozen": r"frozen|stands? still|never chang",
    "held_samples": r"\bheld\b|repeat",
    "outliers": r"outlier|spike|far off",
    "position_spike": r"outlier|spike|far off",
    "jump": r"jump",
    "position_jump": r"jump",
    "coarse": r"coarse|round",
    "one_sided_commands": r"below 0|one-sided|0 to 1|\[0, 1\]",
    "pose_velocity_disagree": r"agree",
    "wrong_frame": r"frame",
    "z_up": r"z is up|z up",
    "z_up_or_reversed": r"z is up|z up",
    "heading_offset": r"(heading|yaw|compass).*(off|turned|backwards)",
    "length_unit": r"\b(feet|cm|centimetres|metres)\b",
    "speed_unit": r"\b(knots|m/s)\b",
    "time_unit": r"clock|\bt\b.*(second|fast|slow)",
    "healthy_not_healthy": r"healthy",
}


class Named(NamedTuple):
    """What an answer says about a damaged log; None where nothing was asked."""

    damage: bool | None = None
    wrong: tuple[str, ...] | None = None
    fault: bool | None = None
    score: scoring.Score = scoring.Score.WRONG


def judge_damage(label: Mapping[str, Any], diagnosis: Mapping[str, Any], refused: str, vehicle: Vehicle) -> Named:
    """Compare an answer, or the sentence with which the log was refused, with the label of a damaged log."""
    by, found = label["named_by"], diagnosis["effects"]
    declared = declared_groups(diagnosis)
    names = {effect["name"] for effect in found}
    beside = names.union(*(same_class(name, declared) for name in names))
    named = _names_it(by, diagnosis.get("findings", ())) or bool(beside & set(by["effects"])) or _says_it(by, refused)
    at_fault = thrusters_right(label, found, declared, vehicle)
    true = set(by["effects"]) | set(label["effects"])
    excused = [split_entry(entry) for entry in by["partly"]] if named else []
    wrong = []
    for effect in found:
        name = effect["name"]
        mine = same_class(name, declared)
        faulty = name in label["effects"] and at_fault is False
        allowed = any(name == one and (not some or set(effect["thrusters"]) <= some) for one, some in excused)
        if effect["probability"] > scoring.LIKELY and (faulty or not mine & true) and not allowed:
            wrong.append(name)
    fault = set(label["effects"]) <= names and at_fault is not False if by["shows_fault"] else None
    score = _score(label, diagnosis, vehicle) if named else scoring.Score.WRONG
    if wrong and score is scoring.Score.RIGHT:
        score = scoring.Score.HALF
    return Named(named, tuple(wrong), fault, score)


def _score(label: Mapping[str, Any], diagnosis: Mapping[str, Any], vehicle: Vehicle) -> scoring.Score:
    """The score of an answer that names the damage, which is one true cause; the fault beside it is the other.

    A finding that limits the verdict holds every name below one half, and allows no better verdict than *partly
    explained*: there, each name counts as a claim.
    """
    by = label["named_by"]
    values = label["values"] if by["shows_fault"] else {}
    hidden = set(label["effects"]) - set(values)  # a fault that the damage hides may be named or not
    excused = ({*by["effects"], *(split_entry(entry)[0] for entry in by["partly"])} - set(values)) | hidden
    rest = {**diagnosis, "effects": [effect for effect in diagnosis["effects"] if effect["name"] not in excused]}
    limited = any(finding.get("limits") for finding in diagnosis.get("findings", ()))
    if limited:
        verdicts = {"partly_explained"} if values else {"no_gap", "partly_explained", "unexplained", "refused"}
    else:
        verdicts = {"explained"} if values else {"no_gap", "explained", "cannot_tell", "refused"}
    truth = scoring.Truth(frozenset(verdicts), values, label["onset_s"])
    given = scoring.score_diagnosis(rest, truth, vehicle, likely=0.0 if limited else scoring.LIKELY)
    return scoring.Score.HALF if given is scoring.Score.WRONG and not values else given


def _names_it(by: Mapping[str, Any], findings: Any) -> bool:
    mine = [finding for finding in findings if finding["code"] in by["codes"]]
    mentioned = {column for finding in mine for column in finding["columns"]}
    return bool(mine) and set(by["columns"]) <= mentioned


def _says_it(by: Mapping[str, Any], sentence: str) -> bool:
    is_named = any(re.search(REFUSALS[code], sentence, re.IGNORECASE) for code in by["codes"])
    return is_named and all(re.search(rf"\b{column}\b", sentence) for column in by["columns"])
