"""How sure an answer is: probabilities over all explanations that were tried, and sizes that this log would show."""

from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.identify.following import nudged_chi2
from auv_torchrl.diagnosis.identify.hypotheses import declared
from auv_torchrl.diagnosis.identify.paths import without_nuisance
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.screen import Field
from auv_torchrl.diagnosis.identify.search import Found
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import FAINT, FOLLOWS, LITTLE, SHOWS, STANDS_IN
from auv_torchrl.diagnosis.verdict import OTHERS, Alternative, Estimate
from auv_torchrl.sysid.posterior import probabilities, weights

NONE, UNKNOWN = "none", "unknown"
SOMETHING_UNKNOWN = "something unknown"
LEAST_LISTED = 0.03  # probability below which an alternative goes with the others: a reader acts on none of these


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
    weight: dict[tuple[tuple[str, ...], str], float] = {}

    def add(effects: tuple[str, ...], besides: str, probability: float) -> None:
        weight[effects, besides] = weight.get((effects, besides), 0.0) + probability

    for effects, share in weights(found.trace, found.problem.settings.tempering).items():
        beside = share * unknown
        alone = beside * STANDS_IN if effects else beside
        add(effects, "", share - beside)
        add((), SOMETHING_UNKNOWN, alone)
        add(effects, SOMETHING_UNKNOWN, beside - alone)
    likely = [Alternative(*key, probability) for key, probability in weight.items() if probability >= LEAST_LISTED]
    rest = 1.0 - sum(one.probability for one in likely)
    if rest > 0.0:
        likely.append(Alternative((), OTHERS, rest))
    return tuple(sorted(likely, key=lambda one: -one.probability))


Member = tuple[str, str]  # effect, parameter
MORE_FLIGHTS = (3, 10)  # times as many as there were: an afternoon more, and all that is worth to be flown


def detectable_sizes(field: Field, hidden: frozenset[Member]) -> dict[str, Estimate]:
    """By effect, the parameter that shows best; ``low`` and ``high`` are the sizes in either direction.

    Parameters that are ``hidden`` do not count.
    """
    known = field.problem.known
    return _sizes(field if known is None else _under(field, known.nuisance_covariance), hidden)


def _under(field: Field, nuisance_covariance: Floats) -> Field:
    """The same responses, where nuisance parameters have another covariance (k, k)."""
    problem = replace(
        field.problem, nuisance_covariance=nuisance_covariance, nuisance_precision=np.linalg.inv(nuisance_covariance)
    )
    b, A = without_nuisance(problem, field.quadratic, field.explanation)
    first = len(field.values[0])
    return replace(field, problem=problem, b=b[first:], A=A[first:, first:])


def _sizes(field: Field, hidden: frozenset[Member]) -> dict[str, Estimate]:
    found: dict[str, tuple[float, Estimate]] = {}
    for i, candidate in enumerate(field.problem.candidates):
        name = field.moved_most(candidate)
        if candidate.discrete or not field.seen[i] or (candidate.effect, name) in hidden:
            continue
        p = declared(candidate.effect, field.problem.vehicle).parameters[name]
        nominal = declared(candidate.effect, field.problem.vehicle).nominal[name]
        shows = float(np.sqrt(SHOWS / field.A[i, i]))  # how much of the candidate would show
        size = abs(candidate.values[name] - nominal) * shows
        relative = size / (p.high - p.low)
        if candidate.effect not in found or relative < found[candidate.effect][0]:
            value = nominal + size if nominal + size <= p.high else nominal - size
            low, high = max(p.low, nominal - size), min(p.high, nominal + size)
            found[candidate.effect] = relative, Estimate(value, low, high, nominal, p.unit)
    return {effect: estimate for effect, (_, estimate) in found.items()}


def with_more_flights(field: Field, hidden: frozenset[Member]) -> dict[int, dict[str, Estimate]]:
    """The same sizes by number of healthy flights, had there been more; none where nothing was learnt from flights.

    More flights tell better what the sound vehicle is. By how much it differs from flight to flight stays, and so does
    what the sensors of this log leave open.
    """
    known = field.problem.known
    if known is None or known.shrinks is None:
        return {}
    return {
        times * known.flights: _sizes(
            _under(field, known.nuisance_covariance - (1 - 1 / times) * known.shrinks), hidden
        )
        for times in MORE_FLIGHTS
    }


def hidden_members(problem: Problem, found: Found) -> frozenset[Member]:
    """Parameters whose response on this log is none, once the motion that nobody measured follows it.

    A response is worked out along the measured motion. Where a part of that is a guess, the guess may change with the
    effect so that nothing of it shows: a current, without positions and speeds over ground.
    """
    if not problem.layout.moves_unseen:
        return frozenset()
    smallest: dict[Member, tuple[float, int]] = {}
    candidates = problem.candidates
    for i, candidate in enumerate(candidates):
        if not candidate.discrete and found.field.seen[i] and len(candidate.values) == 1:
            (name,) = candidate.values
            size = abs(candidate.values[name] - declared(candidate.effect, problem.vehicle).nominal[name])
            smallest[candidate.effect, name] = min(smallest.get((candidate.effect, name), (np.inf, i)), (size, i))
    best = found.best
    rows = [best.explanation]
    for _, i in smallest.values():
        rows += [best.explanation.with_candidate(candidates[i], problem.vehicle, sign) for sign in (1.0, -1.0)]
    chi2 = nudged_chi2(problem, rows, best.path, FOLLOWS)
    rises = 0.5 * (chi2[1::2] + chi2[2::2]) - chi2[0]  # either way, so that no slope plays a part
    due = np.array([found.field.A[i, i] for _, i in smallest.values()])
    faint = (rises < FAINT * due) & (rises < LITTLE)
    return frozenset(member for member, is_faint in zip(smallest, faint, strict=True) if is_faint)
