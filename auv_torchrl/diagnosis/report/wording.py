"""Names and clauses as people write them."""

import math

from auv_torchrl.diagnosis.configured import set_wrong
from auv_torchrl.diagnosis.report.svg import number
from auv_torchrl.diagnosis.verdict import Confirmation, Diagnosis, Errors, Gap


def words(name: str) -> str:
    """``thruster_gain`` as people write it; ``gain_4`` is left alone."""
    return name.replace("_", " ")


def sentence(text: str) -> str:
    """A clause with a capital and a full stop."""
    return text[:1].upper() + text[1:].rstrip(".") + "." if text else ""


def measured_errors(gap: Gap | Confirmation) -> list[tuple[str, str, Errors]]:
    """What was measured, with its unit and errors."""
    kinds = (("position", "m", gap.position_m), ("heading", "rad", gap.yaw_rad), ("velocity", "m/s", gap.velocity))
    return [(name, unit, errors) for name, unit, errors in kinds if errors is not None]


def diverged(diagnosis: Diagnosis) -> str:
    """That no share can be told because the simulator as it was diverges, and how errors shrink; else nothing."""
    gap, told, diverges = diagnosis.gap, [], False
    for name, unit, errors in measured_errors(gap):
        shown = [row for row in zip(gap.horizon_s, errors.before, errors.after, strict=True) if math.isfinite(row[2])]
        numbers = [row for row in shown if math.isfinite(row[1])]
        diverges = diverges or len(numbers) < len(shown)
        if numbers:
            horizon, before, after = numbers[-1]
            told.append(f"; {name} {number(before, 2)} → {number(after, 2)} {unit} at {horizon:g} s")
    if gap.closed is not None or not diverges:
        return ""
    without = "the effects" if diagnosis.effects else "calibration"
    return f"without {without} the simulator diverges{''.join(told)}"


def to_do(diagnosis: Diagnosis) -> list[str]:
    """What to fly first, where explanations are left open, what to set, and what to do about each effect."""
    experiment = diagnosis.next_experiment
    first = [f"fly {experiment.commands}: {experiment.why}"] if experiment else []
    set_back = (finding.remedy for finding in set_wrong(diagnosis.findings, diagnosis.effects))
    advised = (advice.do for effect in diagnosis.effects for advice in effect.advice)
    return [sentence(line) for line in (*first, *set_back, *advised)]
