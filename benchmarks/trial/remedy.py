"""What an owner does about an answer: sets what it says to set, and repairs what it names, right or wrong."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from auv_torchrl.diagnosis import Diagnosis
from auv_torchrl.diagnosis.conclude.findings import to_change
from benchmarks.trial.cases import Effects

_TRIMMED = {"buoyancy": "force"}  # effects that are undone by as much as the answer says, not as much as there is


@dataclass(frozen=True)
class Remedy:
    """What is done to a vehicle and its firmware."""

    parameters: Mapping[str, float]  # that are set
    repaired: tuple[tuple[str, str], ...]  # effects and their parameters that are made nominal
    trimmed: Effects  # what is hung on or taken off

    @property
    def said(self) -> str:
        """In words."""
        parts = [f"{name} {value:g}" for name, value in self.parameters.items()]
        parts += [f"{effect} {member}" for effect, member in self.repaired]
        parts += [f"{effect} {value:+.1f}" for effect, own in self.trimmed.items() for value in own.values()]
        return ", ".join(parts)


def remedy_of(diagnosis: Diagnosis) -> Remedy:
    """What an answer asks for: parameters where it has any, else whatever is likely is repaired."""
    repaired, trimmed = [], {}
    for effect in diagnosis.effects:
        if not effect.is_likely or effect.calibrates:
            continue
        if any(one.param for one in effect.advice):
            continue
        values = {name: own.value for name, own in effect.parameters.items() if not own.is_nominal}
        if effect.name in _TRIMMED:
            trimmed[effect.name] = {name: round(-value, 1) for name, value in values.items()}
        else:
            repaired += [(effect.name, name) for name in values]
    return Remedy(to_change(diagnosis), tuple(repaired), trimmed)


def mended(effects: Effects, remedy: Remedy) -> dict[str, dict[str, Any]]:
    """The scenario once that was done; a good part that was exchanged for a good one changes nothing."""
    left: dict[str, dict[str, Any]] = {}
    for effect, own in effects.items():
        named = {name for other, name in remedy.repaired if other == effect}
        kept = {} if "pair" in own and named else {name: value for name, value in own.items() if name not in named}
        if kept:
            left[effect] = kept
    for effect, own in remedy.trimmed.items():
        there = left.get(effect, {})
        left[effect] = {name: there.get(name, 0.0) + value for name, value in own.items()}
    return left


def still_mirrored(mirrored: tuple[int, ...], remedy: Remedy) -> list[int]:
    """Thrusters whose phase wires stay exchanged; a parameter of the firmware leaves them as they are."""
    repaired = {*remedy.repaired}
    return [n for n in mirrored if not repaired & {("thruster_gain", f"gain_{n}"), ("thruster_swap", f"command_{n}")}]
