"""Names and clauses as people write them."""

from auv_torchrl.diagnosis.configured import set_wrong
from auv_torchrl.diagnosis.verdict import Diagnosis


def words(name: str) -> str:
    """``thruster_gain`` as people write it; ``gain_4`` is left alone."""
    return name.replace("_", " ")


def sentence(text: str) -> str:
    """A clause with a capital and a full stop."""
    return text[:1].upper() + text[1:].rstrip(".") + "." if text else ""


def to_do(diagnosis: Diagnosis) -> list[str]:
    """What to fly first, where explanations are left open, what to set, and what to do about each effect."""
    experiment = diagnosis.next_experiment
    first = [f"fly {experiment.commands}: {experiment.why}"] if experiment else []
    set_back = (finding.remedy for finding in set_wrong(diagnosis.findings, diagnosis.effects))
    advised = (advice.do for effect in diagnosis.effects for advice in effect.advice)
    return [sentence(line) for line in (*first, *set_back, *advised)]
