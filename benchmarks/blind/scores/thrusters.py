"""Which thrusters are at fault, by a label and by an answer, and what the answer declares exchangeable."""

import re
from collections.abc import Mapping
from typing import Any

from auv_torchrl.effects import EFFECTS, get_effect
from auv_torchrl.vehicle import Vehicle


def split_entry(entry: str) -> tuple[str, frozenset[int]]:
    """Effect and thrusters of an entry such as ``thruster_gain 5`` or ``thruster_gain:5``."""
    effect = max((name for name in EFFECTS if entry.startswith(name)), key=len, default=entry)
    return effect, frozenset(int(number) for number in re.findall(r"\d+", entry.removeprefix(effect)))


def declared_groups(diagnosis: Mapping[str, Any]) -> list[list[str]]:
    """The entries that an answer declared indistinguishable, group by group."""
    return [group for group in diagnosis.get("indistinguishable", ()) if len(group) > 1]


def same_class(effect: str, declared: list[list[str]]) -> set[str]:
    """Effects that were declared indistinguishable from this one, itself included."""
    groups = [{split_entry(entry)[0] for entry in group} for group in declared]
    return {effect}.union(*(group for group in groups if effect in group))


def thrusters_at_fault(effect: str, values: Mapping[str, float], vehicle: Vehicle) -> frozenset[int] | None:
    """Thrusters that the label changes; None for an effect of all or none of them."""
    declared = get_effect(effect).member_parameters(vehicle)
    nominal = get_effect(effect).nominal(vehicle)
    changed = {
        int(k.rsplit("_", 1)[1]) for k, v in values.items() if declared[k].over == "thruster" and v != nominal[k]
    }
    return frozenset(changed) if 0 < len(changed) < vehicle.thrusters else None


def thrusters_right(
    label: Mapping[str, Any], found: list[dict[str, Any]], declared: list[list[str]], vehicle: Vehicle
) -> bool | None:
    """Whether the thrusters at fault are named, or declared exchangeable; None where the label has none."""
    verdicts = []
    for effect, values in label["values"].items():
        wanted = thrusters_at_fault(effect, values, vehicle)
        if wanted is None or label["left_out"]:
            continue
        named = {frozenset(f["thrusters"]) for f in found if f["name"] == effect}
        verdicts.append(wanted in named.union(*(exchangeable(effect, one, declared, vehicle) for one in named)))
    return all(verdicts) if verdicts else None


def exchangeable(
    effect: str, thrusters: frozenset[int], declared: list[list[str]], vehicle: Vehicle
) -> set[frozenset[int]]:
    """Sets of thrusters that were declared indistinguishable from some, for an effect of them."""
    sets = [{_thrusters_of(entry, effect, vehicle) for entry in group} for group in declared]
    return {other for group in sets if thrusters in group for other in group if other is not None}


def _thrusters_of(entry: str, effect: str, vehicle: Vehicle) -> frozenset[int] | None:
    """Thrusters of a declared entry such as ``thruster_gain 5`` or ``gain_5, gain_6``; None where it is of others."""
    for part in entry.split(" with "):
        named, thrusters = split_entry(part)
        if named == effect:
            return thrusters
    declared, members = get_effect(effect).member_parameters(vehicle), entry.split(", ")
    if not all(member in declared and declared[member].over == "thruster" for member in members):
        return None
    return frozenset(int(member.rsplit("_", 1)[1]) for member in members)
