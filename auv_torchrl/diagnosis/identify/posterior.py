"""How sure each effect is: probabilities over all explanations that were looked at."""

from auv_torchrl.diagnosis.identify.found import Found
from auv_torchrl.diagnosis.thresholds import STANDS_IN
from auv_torchrl.sysid.posterior import probabilities

NONE, UNKNOWN = "none", "unknown"


def effect_probabilities(found: Found, unknown: float) -> dict[str, float]:
    """Probability that each effect acts, and of "none" and "unknown".

    Evidence is tempered because neither the model of the noise nor the physics is exact. ``unknown`` is the probability
    that something outside the library acts: what is found beside it may stand in for it.
    """
    tempering = found.problem.settings.tempering
    probability = dict.fromkeys(sorted({candidate.effect for candidate in found.problem.candidates}), 0.0)
    probability |= probabilities(found.trace, tempering, NONE)
    for name in probability:
        probability[name] *= 1 - (unknown if name == NONE else STANDS_IN * unknown)
    probability[UNKNOWN] = unknown
    return dict(sorted(probability.items(), key=lambda item: -item[1]))
