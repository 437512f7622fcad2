"""Held-out flight takes back what it can do without: effects beside others, members of a family, one by one."""

from collections.abc import Iterator
from dataclasses import replace

from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.fit import fit_by_simulation
from auv_torchrl.diagnosis.identify.found import Found
from auv_torchrl.diagnosis.identify.hypotheses import Settings, apply_values
from auv_torchrl.diagnosis.identify.neighbours import is_of_family, weighed, without
from auv_torchrl.diagnosis.identify.paths import Fit
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.validate.predict import predict_by
from auv_torchrl.diagnosis.validate.veto import scaled_errors, worse
from auv_torchrl.flightlog import FlightLog
from auv_torchrl.sysid.trace import Outcome, SearchTrace


def take_back(found: Found, testing: FlightLog, settings: Settings) -> Found:
    """What was found, less each statement without which held-out flight is predicted as well.

    A statement is an effect beside others, or a member beside others of its family. It stays where some quantity is
    predicted worse without it, by more than chance; of several that may go, the one that does most harm goes first.
    """
    while (less := _without_one(found, testing, settings)) is not None:
        found = less
    return found


def _without_one(found: Found, testing: FlightLog, settings: Settings) -> Found | None:
    problem, best = found.problem, found.best
    smaller = list(_smaller(problem, best))
    if not smaller:
        return None
    each = [*smaller, best.explanation]
    vehicles = [apply_values(problem.vehicle, one.values(problem.vehicle)) for one in each]
    predictions = predict_by(problem, testing, vehicles, settings)
    errors, whole = scaled_errors(predictions), len(smaller)
    needless = [i for i in range(whole) if not worse(predictions, whole, i)]
    if not needless:
        return None
    kept = smaller[min(needless, key=lambda i: errors[i])]
    fit = fit_by_simulation(problem, kept, best.path)
    gone = set(best.explanation.effects) - set(kept.effects)
    how = f"without {' and '.join(sorted(gone)) or 'values of a family'}, for held-out flight"
    record = weighed(problem, found.field, fit.explanation, fit.evidence, fit.excess, how, Outcome.KEPT)
    # What is needless beside one explanation is so beside another that does the same.
    before = (
        replace(one, outcome=Outcome.REFUTED)
        if one.outcome is Outcome.KEPT or (one.simulated and gone and gone < {*one.names})
        else one
        for one in found.trace.records
    )
    return replace(found, best=fit, fits=(fit, *found.fits), trace=SearchTrace((*before, record)))


def _smaller(problem: Problem, best: Fit) -> Iterator[Explanation]:
    """The explanation without each of its statements, all else moved as fits best by its quadratic."""
    terms, effects = best.explanation.terms, best.explanation.effects
    parts = [[p for p, term in enumerate(terms) if term.effect == name] for name in effects if len(effects) > 1]
    for name in effects:
        family = [p for p, term in enumerate(terms) if term.effect == name and is_of_family(problem, term)]
        parts += [[p] for p in family if len(family) > 1]
    return (without(problem, best, places)[0] for places in parts)
