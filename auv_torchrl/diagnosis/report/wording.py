"""Names, numbers and clauses of a diagnosis as people write them."""

import math
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cache

from auv_torchrl.diagnosis.conclude.findings import set_wrong
from auv_torchrl.diagnosis.conclude.summary import SUSPECT, suspects
from auv_torchrl.diagnosis.localize.wording import does_otherwise
from auv_torchrl.diagnosis.unanswered.wording import not_answering
from auv_torchrl.diagnosis.verdict import (
    FLOOR_ASSUMED,
    OTHERS,
    Confirmation,
    Decision,
    Diagnosis,
    Errors,
    Estimate,
    FoundEffect,
    Gap,
    NextExperiment,
    Verdict,
    how_sure,
)
from auv_torchrl.effects import EFFECTS
from auv_torchrl.quantities import between, estimated, number, percent, scale, with_unit, words

LEAST_SHOWN = 0.01  # probability below which nobody acts on an alternative
SOUND_DIVE = (
    "record one dive on which the vehicle is sound and give it with --healthy FILE: it tells a fault from a vehicle "
    "file that is wrong"
)


@dataclass(frozen=True)
class Shown:
    """An estimate as people read it; value, interval and nominal value share a unit, which is empty for none."""

    value: str
    interval: str
    nominal: str
    unit: str


def shown(estimate: Estimate) -> Shown:
    """An estimate with its interval and nominal value in the unit that suits the largest of them."""
    e = estimate
    factor, unit = scale(e.unit, _largest((e.value, e.low, e.high, e.nominal)))
    value, low, high = factor * e.value, factor * e.low, factor * e.high
    fitted = low < high or not math.isfinite(low) or not math.isfinite(high)
    return Shown(
        estimated(value, low, high) if fitted else _round(value), between(low, high), _round(factor * e.nominal), unit
    )


def _round(nominal: float) -> str:
    """A value that is known: no zeros behind it."""
    return f"{nominal:.3g}" if math.isfinite(nominal) else "–"


def sentence(text: str) -> str:
    """A clause with a capital and a full stop, and with names of effects and parameters in words."""
    text = _names().sub(lambda found: words(found[0]), text)
    return text[:1].upper() + text[1:].rstrip(".") + "." if text else ""


@cache
def _names() -> re.Pattern[str]:
    """Names of effects and of their parameters that people would write in several words."""
    every = [p for effect in EFFECTS.values() for p in effect.parameters]
    single = {name for name in (*EFFECTS, *(p.name for p in every if p.over is None)) if "_" in name}
    families = {p.name for p in every if p.over is not None}
    which = r"\d+|surge|sway|heave|roll|pitch|yaw|[xyz]"
    longest_first = sorted(single, key=len, reverse=True)
    return re.compile(rf"\b(?:{'|'.join(longest_first)}|(?:{'|'.join(families)})_(?:{which})(?:_(?:{which}))?)\b")


def measured_errors(gap: Gap | Confirmation) -> list[tuple[str, str, Errors]]:
    """What was measured, with its errors in a unit that suits their size, and that unit."""
    kinds = (("position", "m", gap.position_m), ("heading", "rad", gap.yaw_rad), ("velocity", "m/s", gap.velocity))
    found = []
    for name, si, errors in kinds:
        if errors is not None:
            factor, unit = scale(si, _largest((*errors.before, *errors.after)))
            rows = ([factor * value for value in row] for row in (errors.before, errors.after, errors.floor))
            found.append((name, unit, Errors(*map(tuple, rows))))
    return found


def _largest(values: tuple[float, ...]) -> float:
    return max((abs(value) for value in values if math.isfinite(value)), default=0.0)


def diverged(diagnosis: Diagnosis) -> str:
    """That no share can be told because the simulator as it was diverges, and how errors shrink; else nothing."""
    gap, changes, diverges = diagnosis.gap, [], False
    for name, unit, errors in measured_errors(gap):
        shown = [row for row in zip(gap.horizon_s, errors.before, errors.after, strict=True) if math.isfinite(row[2])]
        numbers = [row for row in shown if math.isfinite(row[1])]
        diverges = diverges or len(numbers) < len(shown)
        if numbers:
            horizon, before, after = numbers[-1]
            change = with_unit(f"{number(before, 2)} → {number(after, 2)}", unit)
            changes.append(f"; {name} {change} at {horizon:g} s")
    if gap.closed is not None or not diverges:
        return ""
    without = "the effects" if diagnosis.effects else "calibration"
    return f"without {without} the simulator diverges{''.join(changes)}"


def next_best(decision: Decision) -> str:
    """Which explanation comes next, and what tells it from the best one."""
    if not decision.next_best:
        return ""
    channels = ", ".join(f"{name} ({percent(share)})" for name, share in decision.apart.items())
    by_channel = f"; what tells it apart: {channels}" if channels else ""
    return f"The next best explanation is {words(decision.next_best)}{by_channel}."


def to_do(diagnosis: Diagnosis) -> list[str]:
    """What to look at, what to set, what to repair, and what to fly where explanations are left open, in this order."""
    look = [finding.remedy for finding in not_answering(diagnosis.findings)]
    if loose := diagnosis.where.intermittence:
        at = loose.thruster
        look.append(f"look at plug and wires of thruster {at}, at weed in its propeller, and at its speed controller")
    elif unlike := _alone(diagnosis):
        look.append(
            f"look at the propeller and the wires of thruster {unlike}, and exchange its speed controller with that of "
            "a neighbour: if the fault goes with the controller, replace it, else the motor"
        )
    set_back = (finding.remedy for finding in set_wrong(diagnosis.findings, diagnosis.effects))
    repair, perhaps = (
        [
            how_sure(advice.do, effect.probability)
            for effect in diagnosis.effects
            for advice in effect.advice
            if effect.is_likely is likely and (likely or (effect.gap_closed or 0.0) > SUSPECT)
        ]
        for likely in (True, False)
    )
    found = bool(diagnosis.where.intermittence or _alone(diagnosis))
    sound = [SOUND_DIVE] if lacks_sound_dive(diagnosis) and not found else []
    experiment = diagnosis.next_experiment
    fly = [_to_fly(experiment)] if experiment else []
    return list(dict.fromkeys(sentence(line) for line in (*look, *set_back, *repair, *sound, *perhaps, *fly)))


def _alone(diagnosis: Diagnosis) -> int | None:
    """The one thruster that was seen to push otherwise than commanded, where no effect is named."""
    if measured := diagnosis.where.thrust_map:
        return measured.thruster
    if diagnosis.verdict is Verdict.UNEXPLAINED and does_otherwise(diagnosis.where):
        return suspects(diagnosis.where)[0]
    return None


def _to_fly(experiment: NextExperiment) -> str:
    """The next experiment: by hand where a pilot can, why, and the file."""
    if not experiment.by_hand:
        return f"fly {experiment.commands}: {experiment.why}"
    why = f"this tells {experiment.tells}" if experiment.tells else experiment.why
    return f"{experiment.by_hand} (as commands in {experiment.commands}): {why}"


def lacks_sound_dive(diagnosis: Diagnosis) -> bool:
    """Whether a dive of the sound vehicle is what would tell a fault from a file that is wrong."""
    assumed = any(finding.code == FLOOR_ASSUMED for finding in diagnosis.findings)
    open_ended = diagnosis.verdict in (Verdict.PARTLY_EXPLAINED, Verdict.UNEXPLAINED)
    return assumed and (open_ended or any(effect.calibrates for effect in diagnosis.effects))


@dataclass(frozen=True)
class Row:
    """A line of the table of an effect: one value, or one that all members of a family have."""

    name: str
    estimate: Estimate


def rows(effect: FoundEffect) -> list[Row]:
    """The values of an effect; where all members of a family read the same, one line says so."""
    families: dict[str, dict[int, Estimate]] = {}
    for name, estimate in effect.parameters.items():
        family, _, number = name.rpartition("_")
        if number.isdigit():
            families.setdefault(family, {})[int(number)] = estimate
    equal = {
        family: members
        for family, members in families.items()
        if len(members) > 1 and len({(shown(e).value, shown(e).nominal) for e in members.values()}) == 1
    }
    rest = {name: e for name, e in effect.parameters.items() if name.rpartition("_")[0] not in equal}
    found = [
        Row(f"{words(family)} {_listed(members)}", _widest([*members.values()])) for family, members in equal.items()
    ]
    return found + [Row(words(name), estimate) for name, estimate in rest.items()]


def _listed(numbers: Collection[int]) -> str:
    """Numbers in words: ``1 to 8`` or ``2, 5``."""
    first, last = min(numbers), max(numbers)
    return f"{first} to {last}" if last - first + 1 == len(numbers) > 2 else ", ".join(map(str, sorted(numbers)))


def _widest(estimates: Sequence[Estimate]) -> Estimate:
    """The first of some estimates with the interval that holds all of theirs."""
    return replace(estimates[0], low=min(e.low for e in estimates), high=max(e.high for e in estimates))


def either(diagnosis: Diagnosis) -> dict[str, float]:
    """The alternatives of a diagnosis in words, with their probabilities."""
    found: dict[str, float] = {}
    for one in diagnosis.alternatives:
        found[one.called] = found.get(one.called, 0.0) + one.probability
    return found


def likely_causes(diagnosis: Diagnosis, most: int | None = None) -> dict[str, float]:
    """The same, at most so many of those that are worth a line; behind them what all others have together."""
    every = either(diagnosis)
    shown = [what for what, probability in every.items() if what != OTHERS and probability >= LEAST_SHOWN][:most]
    causes = {what: every[what] for what in shown}
    others = sum(every.values()) - sum(causes.values())
    return causes | ({OTHERS: others} if others >= LEAST_SHOWN else {})
