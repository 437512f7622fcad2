"""How sure each effect is: probabilities over all explanations that were looked at."""

from auv_torchrl.diagnosis.identify.found import Found
from auv_torchrl.diagnosis.thresholds import STANDS_IN
from auv_torchrl.diagnosis.verdict import Alternative
from auv_torchrl.sysid.posterior import probabilities, weights

NONE, UNKNOWN = "none", "unknown"
SOMETHING_UNKNOWN = "something unknown"
LEAST_TOLD = 0.03  # probability below which an alternative goes with the others: a reader acts on none of these


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


def alternatives(found: Found, unknown: float) -> tuple[Alternative, ...]:
    """The explanations of a log of which one is true, the likeliest first; their probabilities add up to 1.

    The share of :data:`STANDS_IN` of what is found beside something ``unknown`` is that unknown alone.
    """
    told: dict[tuple[tuple[str, ...], str], float] = {}

    def add(effects: tuple[str, ...], besides: str, probability: float) -> None:
        told[effects, besides] = told.get((effects, besides), 0.0) + probability

    for effects, share in weights(found.trace, found.problem.settings.tempering).items():
        beside = share * unknown
        alone = beside * STANDS_IN if effects else beside
        add(effects, "", share - beside)
        add((), SOMETHING_UNKNOWN, alone)
        add(effects, SOMETHING_UNKNOWN, beside - alone)
    likely = [Alternative(*key, probability) for key, probability in told.items() if probability >= LEAST_TOLD]
    rest = 1.0 - sum(one.probability for one in likely)
    if rest > 0.0:
        likely.append(Alternative((), "others", rest))
    return tuple(sorted(likely, key=lambda one: -one.probability))
