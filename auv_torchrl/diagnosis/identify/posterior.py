"""How sure each effect is: probabilities over all explanations that were weighed."""

import numpy as np

from auv_torchrl.diagnosis.identify.found import Found
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.small import is_minor
from auv_torchrl.diagnosis.thresholds import SCREENING_DOUBT, STANDS_IN

NONE, UNKNOWN = "none", "unknown"


def effect_probabilities(problem: Problem, found: Found, unknown: float) -> dict[str, float]:
    """Probability that each effect acts, and of "none" and "unknown".

    Each explanation gets its evidence, tempered because neither the model of the noise nor the physics is exact; an
    effect gets the sum over the explanations it is part of. ``unknown`` is the probability that something outside the
    library acts.
    """
    told = [judged for judged in found.polished if np.isfinite(judged.evidence) and not is_minor(problem, judged)]
    weights = [(judged.explanation.effects, judged.evidence) for judged in told]
    tried = {effects for effects, _ in weights}
    top = max((s.evidence for s in found.screened), default=0.0)
    best = found.best.evidence
    for screened in found.screened:
        if screened.explanation.effects not in tried:
            lag = min(0.0, screened.evidence - top) - SCREENING_DOUBT
            weights.append((screened.explanation.effects, best + lag))
    evidence = np.array([weight for _, weight in weights]) * problem.settings.tempering
    share = np.exp(evidence - evidence.max())
    share /= share.sum()
    probability = {NONE: 0.0}
    for (effects, _), part in zip(weights, share, strict=True):
        for name in effects or (NONE,):
            probability[name] = probability.get(name, 0.0) + float(part)
    for name in probability:  # what is found beside something unknown may stand in for it
        probability[name] *= 1 - (unknown if name == NONE else STANDS_IN * unknown)
    probability[UNKNOWN] = unknown
    return dict(sorted(probability.items(), key=lambda item: -item[1]))
