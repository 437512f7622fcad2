"""No explanation stands against unseen flight.

What predicts held-out stretches badly does not explain the gap. What they are predicted as well without is taken back,
effects and members of a family one by one, unless the log itself asks for it.
"""

from collections.abc import Collection, Iterator
from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.fit import fit_by_simulation
from auv_torchrl.diagnosis.identify.hypotheses import Settings, apply_values
from auv_torchrl.diagnosis.identify.neighbours import is_of_family, weighed, without
from auv_torchrl.diagnosis.identify.paths import Fit, leaves_much, spread
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.search import Found
from auv_torchrl.diagnosis.motion.rollout import DIVERGING
from auv_torchrl.diagnosis.thresholds import CLOSED_IF_EXPLAINED, STILL_FAR, WITHIN_FLOOR, WORSE
from auv_torchrl.diagnosis.validate.predict import Predictions, predict_by
from auv_torchrl.flightlog import Finding, FlightLog, Severity
from auv_torchrl.quantities import percent
from auv_torchrl.sysid.trace import Outcome, SearchTrace

# Of explanations that predict as well as without them, the part that is taken back by chance: it costs one answer in
# twenty there, and an explanation that predicts worse costs the trust in all others. It is shared by the channels.
BY_CHANCE = 0.05
FLEW_AWAY = 1e6  # floors, stands for what is not finite
EVERYTHING = "everything together"


@DIVERGING
def scaled_errors(p: Predictions) -> np.ndarray:
    """Root mean square error (V,) of each vehicle over all held-out samples, in units of the floor."""
    scaled = (p.error / p.spread[:, None]) ** 2
    mean = np.array([scaled[:, v][p.windows.trust > 0].mean() for v in range(scaled.shape[1])])
    return np.sqrt(np.where(np.isfinite(mean), mean, np.inf))


def worse(p: Predictions, before: int, after: int) -> tuple[str, ...]:
    """Quantities that one vehicle predicts worse than another in held-out stretches, by more than noise can do.

    The answer is ``EVERYTHING`` where all numbers together are worse, else the channels that are so by
    themselves: a better position does not pay for a worse heading.
    """
    errors = scaled_errors(p)
    if errors[after] > max(WORSE * errors[before], WITHIN_FLOOR):
        return (EVERYTHING,)
    return worse_channels(p, before, after)


@DIVERGING
def worse_channels(p: Predictions, before: int, after: int) -> tuple[str, ...]:
    """The channels that one vehicle predicts worse than another, each tested by itself over the held-out stretches.

    A stretch counts once, because its samples share their start: as the logarithm of the factor by which its error
    grows. Student's t says whether the mean is above that of ``WORSE``. Errors below ``STILL_FAR`` floors
    count as equal: the floor does not hold the uncertainty of the values of an explanation.
    """
    from scipy.special import stdtrit  # of Student's distribution; here: it takes long to import

    trusted = p.windows.trust[:, None] > 0
    count = trusted.sum(2)  # (W, 1, C)
    squares = np.where(trusted, p.error / p.spread[:, None], 0.0) ** 2
    mean = np.where(np.isfinite(squares), squares, FLEW_AWAY**2).sum(2) / np.maximum(count, 1)  # (W, V, C)
    size = 0.5 * np.log(np.clip(mean, STILL_FAR**2, FLEW_AWAY**2))
    grows = size[:, after] - size[:, before] - np.log(WORSE)
    found = []
    for channel, each, seen in zip(p.windows.channels, grows.T, count[:, 0].T > 0, strict=True):
        growth = each[seen]
        if len(growth) < 2:
            continue  # of a single stretch nobody knows how much of it is chance
        t = growth.mean() * np.sqrt(len(growth)) / growth.std(ddof=1)
        if t > stdtrit(len(growth) - 1, 1 - BY_CHANCE / len(p.windows.channels)):
            found.append(channel)
    return tuple(found)


def falls_short(p: Predictions, closed: float | None) -> bool:
    """Whether the last vehicle leaves more of the gap than an explanation may, though it fits what was learnt from."""
    return closed is not None and closed < CLOSED_IF_EXPLAINED and bool(scaled_errors(p)[-1] > STILL_FAR)


def only(p: Predictions, before: int, after: int) -> Predictions:
    """The predictions of two of the vehicles."""
    two = {name: getattr(p, name)[:, [before, after]] for name in ("error", "states", "reported")}
    return replace(p, **two)


def shortfalls(short: bool) -> tuple[Finding, ...]:
    """The finding where effects fit the log, but do not predict held-out flight."""
    if not short:
        return ()
    sentence = (
        f"the effects fit this log, but close less than {percent(CLOSED_IF_EXPLAINED)} of the gap in held-out flight"
    )
    return (Finding(Severity.WARNING, "falls_short", sentence, "Fly what next_experiment.csv commands"),)


def vetoes(quantities: Collection[str]) -> tuple[Finding, ...]:
    """The finding where held-out flight takes all effects back, for these quantities; empty without any."""
    if not quantities:
        return ()
    sentence = (
        "the effects that fit this log best predict held-out flight worse than without them "
        f"({', '.join(quantities)}): none is named"
    )
    return (Finding(Severity.WARNING, "vetoed", sentence, "Give a longer log, or one that moves in more ways"),)


def calibration_vetoed(quantities: Collection[str]) -> Finding:
    """The finding where corrected coefficients do not carry over to held-out flight, in these quantities."""
    sentence = (
        "coefficients corrected on this log predict held-out flight worse than the vehicle's file "
        f"({', '.join(quantities)}): the file stands"
    )
    remedy = "Give logs that command what the held-out flight commands, above all in size"
    return Finding(Severity.WARNING, "calibration_vetoed", sentence, remedy)


def take_back(found: Found, testing: FlightLog, settings: Settings) -> Found:
    """What was found, less each statement without which held-out flight is predicted as well.

    A statement is an effect, or a member beside others of its family. It stays where some quantity is predicted worse
    without it, by more than chance; of several that may go, the one that does most harm goes first. One that neither
    helps nor harms there goes where the log is explained without it, too: held-out flight in which thrusters hardly
    turn tells nothing of them. Where what then stays leaves more of the log than no effect does, nothing was found.
    """
    left = found
    while (less := _without_one(left, testing, settings)) is not None:
        left = less
    return replace(left, best=left.none) if left is not found and left.best.chi2 > left.none.chi2 else left


def _without_one(found: Found, testing: FlightLog, settings: Settings) -> Found | None:
    problem, best = found.problem, found.best
    smaller = list(_smaller(found))
    if not smaller:
        return None
    each = [*smaller, best.explanation]
    vehicles = [apply_values(problem.vehicle, one.values(problem.vehicle)) for one in each]
    predictions = predict_by(problem, testing, vehicles, settings)
    errors, whole = scaled_errors(predictions), len(smaller)
    needless = sorted((i for i in range(whole) if not worse(predictions, whole, i)), key=lambda i: errors[i])
    fits = ((fit_by_simulation(problem, smaller[i], best.path), i) for i in needless)
    fit = next((one for one, i in fits if worse(predictions, i, whole) or _may_go(problem, best, one)), None)
    if fit is None:
        return None
    gone = set(best.explanation.effects) - set(fit.explanation.effects)
    how = f"without {' and '.join(sorted(gone)) or 'values of a family'}, for held-out flight"
    record = weighed(problem, found.field, fit.explanation, fit.evidence, fit.excess, how, Outcome.LEFT)
    # What is needless beside one explanation is so beside another that does the same.
    before = (
        replace(one, outcome=Outcome.REFUTED)
        if one.outcome.is_kept or (one.simulated and gone and gone < {*one.names})
        else one
        for one in found.trace.records
    )
    return replace(found, best=fit, fits=(fit, *found.fits), trace=SearchTrace((*before, record)))


def _may_go(problem: Problem, best: Fit, fit: Fit) -> bool:
    """Whether a log is explained without a statement, too: ``fit`` is without it.

    What explains a log is not given up for what leaves much of it. And nothing at all is said where no effect leaves no
    more than chance may leave of the best explanation, as of a sound flight that differs a little from another one.
    """
    if not fit.explanation.effects:
        return abs(fit.chi2 - best.chi2) < spread(best)
    return leaves_much(problem, best) or not leaves_much(problem, fit)


def _smaller(found: Found) -> Iterator[Explanation]:
    """The explanation without each of its statements, all else moved as fits best by its quadratic."""
    problem, best = found.problem, found.best
    terms, effects = best.explanation.terms, best.explanation.effects
    is_needed = len(effects) == 1 and not _may_go(problem, best, found.none)
    parts = [[p for p, term in enumerate(terms) if term.effect == name] for name in effects if not is_needed]
    for name in effects:
        family = [p for p, term in enumerate(terms) if term.effect == name and is_of_family(problem, term)]
        parts += [[p] for p in family if len(family) > 1]
    return (without(problem, best, places)[0] for places in parts)
