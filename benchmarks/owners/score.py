"""What an answer says of an owner's vehicle, against what was flown."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from auv_torchrl.effects import get_effect
from auv_torchrl.effects.effect import Origin
from auv_torchrl.vehicle import Vehicle
from benchmarks.blind.scores.table import Share, Table, counted, median, median_and_largest, targets
from benchmarks.blind.scores.thrusters import declared_groups, exchangeable
from benchmarks.owners.cases import ELSE, FAMILIES, FILES, LOOSE, SENSOR, SOUND, THRUSTER, WIRING, file_of
from benchmarks.scoring import LIKELY

MUST = {  # family: what is right, must, aim
    SOUND: ("a sound vehicle: nothing is called faulty, and nothing unknown acts", "≥ 95 %", "≥ 98 %"),
    THRUSTER: ("one-way, creeping, stalling thruster: named, and nothing sound beside it", "≥ 90 %", "≥ 97 %"),
    WIRING: ("any signed permutation of the plugs: exact", "≥ 95 %", "≥ 99 %"),
    SENSOR: ("sensors that do not answer: named or declared", "≥ 90 %", "≥ 97 %"),
    LOOSE: ("comes and goes: the thruster named, and nothing sound beside it", "≥ 80 %", "≥ 90 %"),
    ELSE: ("outside the library, at one thruster: located first", "≥ 90 %", "≥ 97 %"),
}
BLAMED = "sensors that do not answer: a fault of the vehicle above one half"
FILE_OFF = "the file called off, for more likely than not, although one cause closes more"
SHARE = "comes and goes: the share of the time within its interval"
CPU = "CPU seconds of logs that end unexplained, median / largest"


@dataclass(frozen=True)
class Outcome:
    """What the tables read about one case."""

    case: str
    family: str
    kind: str
    file: str
    right: bool
    blamed: bool  # a fault of the vehicle is likelier than not
    file_off: bool  # a correction of the file is likelier than not although one cause closes more
    share: bool | None  # of what comes and goes: whether the interval holds the share of the time
    verdict: str
    headline: str
    cpu_s: float


def score_owner(name: str, label: Mapping[str, Any], answer: Mapping[str, Any], vehicle: Vehicle) -> Outcome:
    """Compare the answer to a case with its label."""
    nothing = {"verdict": "refused" if "refused" in answer else "error", "effects": [], "findings": [], "where": {}}
    diagnosis = answer.get("diagnosis") or nothing
    claims = [effect for effect in diagnosis["effects"] if effect["probability"] > LIKELY]
    faults = [effect for effect in claims if not effect["calibrates"] and not _is_of_a_sensor(effect["name"])]
    corrections = [effect for effect in claims if effect["calibrates"]]
    closed = max((e["gap_closed"] or 0.0 for e in diagnosis["effects"] if not e["calibrates"]), default=0.0)
    return Outcome(
        case=name,
        family=label["family"],
        kind=label["outside"] or label["damage"] or SOUND,
        file=file_of(label["stranger"], label["slack"]),
        right=_RIGHT[label["family"]](label, diagnosis, claims, vehicle),
        blamed=bool(faults),
        file_off=any((effect["gap_closed"] or 0.0) < closed for effect in corrections),
        share=_holds_share(label, diagnosis) if label["family"] == LOOSE else None,
        verdict=diagnosis["verdict"],
        headline=diagnosis.get("headline") or answer.get("refused") or answer.get("error", ""),
        cpu_s=answer["cpu_s"],
    )


def _is_of_a_sensor(effect: str) -> bool:
    return get_effect(effect).origin is Origin.SENSING


def _names_the_thruster(
    label: Mapping[str, Any], diagnosis: Mapping[str, Any], claims: Sequence[Mapping[str, Any]], vehicle: Vehicle
) -> bool:
    """Whether all that is named as a fact is at the thruster, or at one that was declared exchangeable with it.

    What no effect of the library does is named in words, from the measured map of the thruster.
    """
    mine, declared = frozenset((label["drawn"]["thruster"],)), declared_groups(diagnosis)
    faults = [effect for effect in claims if not effect["calibrates"]]

    def is_mine(effect: Mapping[str, Any]) -> bool:
        at = frozenset(effect["thrusters"])
        return at == mine or mine in exchangeable(effect["name"], at, declared, vehicle)

    mapped = ((diagnosis["where"] or {}).get("thrust_map") or {}).get("thruster") == label["drawn"]["thruster"]
    return (bool(faults) or mapped) and all(is_mine(effect) for effect in faults)


def _holds_share(label: Mapping[str, Any], diagnosis: Mapping[str, Any]) -> bool:
    """Whether the thruster is said to come and go, with an interval that holds the share of the time."""
    found, drawn = (diagnosis["where"] or {}).get("intermittence"), label["drawn"]
    return bool(found) and found["thruster"] == drawn["thruster"] and found["low"] <= drawn["share"] <= found["high"]


def _is_told_at_the_thruster(
    label: Mapping[str, Any], diagnosis: Mapping[str, Any], claims: Sequence[Mapping[str, Any]], vehicle: Vehicle
) -> bool:
    """Whether the thruster is said to come and go, or is the only one that is named, and nothing sound beside it."""
    intermittence = (diagnosis["where"] or {}).get("intermittence") or {}
    others = [effect for effect in claims if not effect["calibrates"]]
    mine = intermittence.get("thruster") == label["drawn"]["thruster"] and not others
    return mine or _names_the_thruster(label, diagnosis, claims, vehicle)


def _is_located(
    label: Mapping[str, Any], diagnosis: Mapping[str, Any], claims: Sequence[Mapping[str, Any]], vehicle: Vehicle
) -> bool:
    """Whether the thruster has the largest share of the gap, or is the only one that is named."""
    shares = (diagnosis["where"] or {}).get("thruster") or {}
    first = max(shares, key=lambda number: shares[number], default="")
    return first == str(label["drawn"]["thruster"]) or _names_the_thruster(label, diagnosis, claims, vehicle)


def _is_exact_wiring(
    label: Mapping[str, Any], diagnosis: Mapping[str, Any], claims: Sequence[Mapping[str, Any]], vehicle: Vehicle
) -> bool:
    """Whether each thruster gets the command that it gets, with its sign."""
    giver, backwards = list(range(1, vehicle.thrusters + 1)), set()
    for effect in claims:
        for parameter, found in effect["parameters"].items():
            number = int(parameter.rpartition("_")[2]) if parameter[-1].isdigit() else 0
            if effect["name"] == "thruster_swap":
                giver[number - 1] = round(abs(found["value"]))
            if effect["name"] in ("thruster_swap", "thruster_gain") and number and found["value"] < 0:
                backwards ^= {number}
    return giver == label["drawn"]["giver"] and backwards == set(label["drawn"]["backwards"])


def _is_silence_told(
    label: Mapping[str, Any], diagnosis: Mapping[str, Any], claims: Sequence[Mapping[str, Any]], vehicle: Vehicle
) -> bool:
    """Whether a finding names a channel that does not follow the vehicle, or a likely effect is of its sensor."""
    false, codes = set(label["named_by"]["columns"] or ()), set(label["named_by"]["codes"])
    told = any(one["code"] in codes and (not false or false & set(one["columns"])) for one in diagnosis["findings"])
    return told or any(_is_of_a_sensor(effect["name"]) for effect in claims)


def _is_sound(
    label: Mapping[str, Any], diagnosis: Mapping[str, Any], claims: Sequence[Mapping[str, Any]], vehicle: Vehicle
) -> bool:
    """Whether the vehicle is called sound, or nothing but the file is said to be off, which explains all."""
    return diagnosis["verdict"] in ("no_gap", "explained") and all(effect["calibrates"] for effect in claims)


_RIGHT = {
    SOUND: _is_sound, THRUSTER: _names_the_thruster, WIRING: _is_exact_wiring, SENSOR: _is_silence_told,
    LOOSE: _is_told_at_the_thruster, ELSE: _is_located,
}  # fmt: skip


def owner_numbers(outcomes: Sequence[Outcome], sensors: str) -> Table:
    """The targets with what was measured."""
    rows = [(*MUST[family], Share.of(o.right for o in _of(outcomes, family))) for family in FAMILIES]
    silent = _of(outcomes, SENSOR)
    unexplained = [o.cpu_s for o in outcomes if o.verdict in ("unexplained", "partly_explained")]
    rows += [
        (BLAMED, "≤ 1 %", "0", Share.of(o.blamed for o in silent)),
        (SHARE, "≥ 80 %", "≥ 90 %", Share.of(o.share for o in outcomes)),
        (FILE_OFF, "≤ 1 %", "0", Share.of(o.file_off for o in outcomes)),
        (CPU, "15, 60", "8, 25", median_and_largest(unexplained)),
    ]
    return targets(f"What owners meet, sensors: {sensors}", rows)


def by_file(outcomes: Sequence[Outcome]) -> Table:
    """Each family with each kind of file."""
    rows = []
    for family in FAMILIES:
        mine = _of(outcomes, family)
        cells = [Share.of(o.right for o in mine if o.file == file).fraction for file in FILES]
        rows.append((family, *cells, counted(o.verdict for o in mine)))
    return Table("By file", ("family", *(f"{file} file" for file in FILES), "verdicts"), rows)


def by_kind(outcomes: Sequence[Outcome]) -> Table:
    """Each kind of fault."""
    rows = []
    for kind in dict.fromkeys(o.kind for o in sorted(outcomes, key=lambda o: (o.family, o.kind))):
        mine = [o for o in outcomes if o.kind == kind]
        seconds = f"{median([o.cpu_s for o in mine]):.0f}"
        rows.append((kind.replace("_", " "), Share.of(o.right for o in mine).fraction, seconds))
    return Table("By kind", ("kind", "right", "median CPU s"), rows)


def not_right(outcomes: Iterable[Outcome]) -> Table:
    """Every case that is not right, with what was said."""
    rows = [
        (o.case, o.kind.replace("_", " "), o.file, o.verdict, o.headline.replace("|", "/"))
        for o in outcomes
        if not o.right or o.file_off or (o.family == SENSOR and o.blamed)
    ]
    return Table("Cases that fail", ("case", "kind", "file", "verdict", "headline"), rows)


def owner_tables(outcomes: Sequence[Outcome], sensors: str) -> list[Table]:
    """All of them, in the order in which they are read."""
    return [owner_numbers(outcomes, sensors), by_file(outcomes), by_kind(outcomes), not_right(outcomes)]


def _of(outcomes: Iterable[Outcome], family: str) -> list[Outcome]:
    return [o for o in outcomes if o.family == family]
