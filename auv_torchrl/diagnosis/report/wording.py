"""Names, numbers and clauses of a diagnosis as people write them."""

import math
import re
from dataclasses import dataclass
from functools import cache

from auv_torchrl.diagnosis.configured import set_wrong
from auv_torchrl.diagnosis.unanswered.wording import not_answering
from auv_torchrl.diagnosis.verdict import Confirmation, Decision, Diagnosis, Errors, Estimate, Gap
from auv_torchrl.effects import EFFECTS
from auv_torchrl.quantities import between, estimated, number, percent, scale, with_unit, words


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
    return Shown(estimated(value, low, high), between(low, high), _round(factor * e.nominal), unit)


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
    gap, told, diverges = diagnosis.gap, [], False
    for name, unit, errors in measured_errors(gap):
        shown = [row for row in zip(gap.horizon_s, errors.before, errors.after, strict=True) if math.isfinite(row[2])]
        numbers = [row for row in shown if math.isfinite(row[1])]
        diverges = diverges or len(numbers) < len(shown)
        if numbers:
            horizon, before, after = numbers[-1]
            change = with_unit(f"{number(before, 2)} → {number(after, 2)}", unit)
            told.append(f"; {name} {change} at {horizon:g} s")
    if gap.closed is not None or not diverges:
        return ""
    without = "the effects" if diagnosis.effects else "calibration"
    return f"without {without} the simulator diverges{''.join(told)}"


def next_best(decision: Decision) -> str:
    """Which explanation comes next, and what tells it from the best one."""
    if not decision.next_best:
        return ""
    channels = ", ".join(f"{name} ({percent(share)})" for name, share in decision.apart.items())
    told = f"; what tells it apart: {channels}" if channels else ""
    return f"The next best explanation is {words(decision.next_best)}{told}."


def to_do(diagnosis: Diagnosis) -> list[str]:
    """What to look at, what to fly where explanations are left open, what to set, and what to do about each effect."""
    look = [finding.remedy for finding in not_answering(diagnosis.findings)]
    experiment = diagnosis.next_experiment
    first = [f"fly {experiment.commands}: {experiment.why}"] if experiment else []
    set_back = (finding.remedy for finding in set_wrong(diagnosis.findings, diagnosis.effects))
    advised = (advice.do for effect in diagnosis.effects for advice in effect.advice)
    return [sentence(line) for line in (*look, *first, *set_back, *advised)]
