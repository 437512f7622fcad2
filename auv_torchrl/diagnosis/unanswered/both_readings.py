"""The two readings of a log in which a channel stands still: the channel does not answer, or the vehicle is faulty.

All other channels are explained by themselves. Where the vehicle that they show moves the channel, it does not answer.
A fault that makes a vehicle stand as still then is the other reading, which that channel alone testifies.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

from auv_torchrl.diagnosis.axes import hold_attitude
from auv_torchrl.diagnosis.doubt import BELIEVED, doubted_alternatives
from auv_torchrl.diagnosis.explain import Given, is_explained_in_part
from auv_torchrl.diagnosis.identify.hypotheses import Settings, apply_values
from auv_torchrl.diagnosis.identify.posterior import UNKNOWN
from auv_torchrl.diagnosis.identify.routing import left_by_plugs
from auv_torchrl.diagnosis.identify.search import Found
from auv_torchrl.diagnosis.localize.unlike import is_unlike, left_at_best
from auv_torchrl.diagnosis.log_search import is_explained
from auv_torchrl.diagnosis.unanswered.held import beside, find_held
from auv_torchrl.diagnosis.unanswered.other_source import (
    Suspect,
    blamed,
    find_other_source,
    in_all_flight,
    left_by,
    share_of_held,
)
from auv_torchrl.diagnosis.unanswered.stillness import Stillness, find_stillness, standing
from auv_torchrl.diagnosis.unanswered.weigh import explained_better, unexplained_by, without
from auv_torchrl.diagnosis.unanswered.wording import (
    in_words,
    named,
    tell,
    tell_contradiction,
    tell_held,
    tell_other_source,
    tell_stands,
)
from auv_torchrl.diagnosis.verdict import (
    OTHERS,
    Alternative,
    Diagnosis,
    EffectProbability,
    Errors,
    FoundEffect,
    Gap,
    Verdict,
    Where,
)
from auv_torchrl.flightlog import Finding, FlightLog, FlightLogError
from auv_torchrl.vehicle import Vehicle

# Of what is left without the other sensor, by the best explanation of all, or by thrusters that do nothing: a false
# sensor outweighs faults, and exchanged plugs outweigh a false pose, of which no plugs explain much.
FAR_LESS = 0.1


class Once(Protocol):
    """Explains a log as if all of its channels followed the vehicle."""

    def __call__(self, log: FlightLog, begin: float, end: float, by: Given | None = None, /) -> tuple[Diagnosis, Found]:
        """The diagnosis and the search of a log, ``by`` something else than what is given to all, where there is such.

        ``begin`` and ``end`` are the shares of the work between which it is done.
        """
        ...


def weigh_readings(log: FlightLog, given: Given, once: Once, unsearched: Callable[[], Diagnosis]) -> Diagnosis:
    """The diagnosis of a log, with what does not answer to commands said first.

    Args:
        log: as it can be followed.
        given: what it is explained by.
        once: explains a log as if all of its channels followed the vehicle.
        unsearched: holds the log against the vehicle of the file, and looks for no effects.
    """
    vehicle, settings = given.vehicle, given.settings
    still = find_stillness(log, vehicle, settings)
    whole = _is_all(log, vehicle, settings, still)
    if not whole and (share := share_of_held(log, vehicle, settings)) is not None:
        return _nothing_else(log, (tell_held(share, log.axes),), unsearched())
    held = () if whole else find_held(log, vehicle, settings, still)
    if held and unexplained_by(hold_attitude(log, vehicle), log, held, settings):
        return _beside_the_held(log, held, given, once, unsearched)
    still = unexplained_by(hold_attitude(log, vehicle), log, still, settings) if still else ()
    if not still:
        return _unless_of_another_source(log, given, *once(log, 0.0, 0.8), once)
    if whole:
        return _nothing_else(log, tell(still, whole, len(log.episodes)), unsearched())
    rest, still = _explain_others(log, settings, still, once)
    # A file that all other channels bear out needs no correction for the sake of one that stands still.
    by = replace(given, uncertainty=()) if rest and rest.verdict is Verdict.NO_GAP else given
    logged, found = once(log, 0.5, 1.0, by)
    if not still or logged.verdict is Verdict.NO_GAP or explained_better(found.problem, found.best.path, still):
        return logged
    silent = tell(still, False, len(log.episodes))
    return _beside(rest, logged, silent) if rest else _alone(logged, silent)


def _beside_the_held(
    log: FlightLog, held: Sequence[Stillness], given: Given, once: Once, unsearched: Callable[[], Diagnosis]
) -> Diagnosis:
    """What the log shows but for stretches in which the vehicle is held."""
    silent, others = tell_stands(held, len(log.episodes)), beside(log, held)
    try:
        rest = weigh_readings(others, given, once, unsearched) if others else None
    except FlightLogError:  # too little is left to explain
        rest = None
    if rest is None:
        return _nothing_else(log, silent, unsearched())
    both = _beside(rest, rest, silent)
    return replace(both, verdict=rest.verdict) if rest.verdict is Verdict.EXPLAINED else both


def _nothing_else(log: FlightLog, silent: tuple[Finding, ...], logged: Diagnosis) -> Diagnosis:
    """That nothing moves with the commands: no fault can be told from that, and none was looked for."""
    return replace(_alone(logged, silent), findings=(*silent, *log.findings))


def _unless_of_another_source(log: FlightLog, given: Given, logged: Diagnosis, found: Found, once: Once) -> Diagnosis:
    """The diagnosis of a log; where nothing explains it, and all would fit but for one source, that is said first.

    Of two sensors that contradict each other one is false: that without which far less is left. All others may show a
    fault. A file that is a guess tells nothing of how much should be left. Coefficients that were corrected take up a
    part of whatever is false: where they are no fact, channels are held against the file as it is.
    """
    if logged.verdict is Verdict.PARTLY_EXPLAINED and any(effect.calibrates for effect in logged.effects):
        given = replace(given, uncertainty=())
        _, found = once(log, 0.8, 0.9, replace(given, settings=replace(given.settings, most_effects=0)))
    if is_explained(found):  # as where the frame of the log is in doubt
        return logged

    def tell_of(suspect: Suspect, whole: bool = False) -> tuple[Finding, ...]:
        """What is said of it; nothing where all flight clears it."""
        confirmed = in_all_flight(suspect, log, found.problem, found.follow.explanation, given.settings)
        if confirmed is None:
            return ()
        stretches = confirmed.stretches if whole else blamed(confirmed.stretches)
        return tell_other_source(stretches, len(log.episodes), whole)

    may_correct = given.is_guess and not is_unlike(found)  # one thruster that explains all needs no other file
    contradict: list[tuple[float, FlightLog, tuple[Finding, ...]]] = []
    for suspect in find_other_source(found.problem, found.follow):
        if set(suspect.channels) >= set(log.axes) and not follows_otherwise(found):
            if silent := tell_of(suspect, whole=True):
                return _alone(logged, silent)
            continue
        others = without(log, [Stillness(name) for name in suspect.channels])
        if others is None:  # what is left needs what is gone
            continue
        left = left_by(others, found.problem, given.settings)
        if left.is_nothing:
            if silent := tell_of(suspect):
                return _alone(logged, silent)
        elif may_correct:
            rest = _explained(others, suspect.contradicts, given, once)
            if rest is not None and (silent := tell_of(suspect)):  # by a file that was corrected anew
                return _beside(rest, logged, silent)
        elif suspect.contradicts:
            contradict.append((left.excess, others, tell_contradiction(blamed(suspect.stretches), len(log.episodes))))
    return _beside_the_false_one(contradict, logged, found, once)


def _beside_the_false_one(
    contradict: Sequence[tuple[float, FlightLog, tuple[Finding, ...]]],
    logged: Diagnosis,
    found: Found,
    once: Once,
) -> Diagnosis:
    """What all others show beside the one of contradicting sensors without which far less is left, if one is so.

    They contradict each other whatever acts on the vehicle, so that all others may show something unknown, too. What
    one thruster makes all of them show is no contradiction. ``contradict`` has for each sensor what is left without it,
    the log of all others, and what is said of it.
    """
    ranked = sorted(contradict, key=lambda one: one[0])
    lefts = [*(excess for excess, *_ in ranked), left_at_best(found)]
    if not ranked or lefts[0] > FAR_LESS * min(lefts[1:]):
        return logged
    _, others, silent = ranked[0]
    try:
        rest, _ = once(others, 0.8, 1.0)
    except FlightLogError:  # too little is left to explain
        return logged
    return _beside(rest, logged, silent)


def follows_otherwise(found: Found) -> bool:
    """Whether exchanged plugs leave far less than no thrust at all: thrusters follow the commands of others."""
    return left_by_plugs(found.problem, found.follow) < FAR_LESS


def _explained(others: FlightLog, may_be_faulty: bool, given: Given, once: Once) -> Diagnosis | None:
    """The diagnosis of all other channels, where that explains them; by a fault of the vehicle only if it may be."""
    try:
        if given.is_guess and not is_explained_in_part(others, given, may_be_faulty):
            return None
        rest, found = once(others, 0.8, 1.0)
    except FlightLogError:  # too little is left to explain
        return None
    faults = any(not effect.calibrates for effect in rest.effects)
    return rest if is_explained(found) and (may_be_faulty or not faults) else None


def _is_all(log: FlightLog, vehicle: Vehicle, settings: Settings, still: Sequence[Stillness]) -> bool:
    """Whether nothing moves all along."""
    return set(log.axes) <= {entry.channel for entry in still if entry.episode is None} | standing(
        log, vehicle, settings
    )


def _explain_others(
    log: FlightLog, settings: Settings, still: tuple[Stillness, ...], once: Once
) -> tuple[Diagnosis | None, tuple[Stillness, ...]]:
    """What all other channels say, None where they say nothing, and what stands still beside the vehicle they show."""
    while still and (others := without(log, still)) is not None:
        try:
            rest, found = once(others, 0.0, 0.5)
        except FlightLogError:  # too little is left to explain
            break
        own = found.problem.vehicle
        shown = apply_values(own, found.best.explanation.values(own))
        kept = unexplained_by(shown, log, still, settings)
        if kept == still:
            return rest, still
        still = kept
    return None, still


def _beside(rest: Diagnosis, logged: Diagnosis, silent: tuple[Finding, ...]) -> Diagnosis:
    """What all other channels say, behind what does not answer; a fault that this alone shows is the other reading."""
    there = {effect.name for effect in rest.effects}
    fits = logged.verdict is Verdict.EXPLAINED
    others = [e for e in logged.effects if fits and e.is_likely and e.name not in there and not e.calibrates]
    limited = Verdict.CANNOT_TELL if rest.verdict is Verdict.NO_GAP else rest.verdict
    verdict = Verdict.PARTLY_EXPLAINED if limited is Verdict.EXPLAINED else limited
    sentences = (*(_sentence(finding.sentence) for finding in silent), *_instead(others, silent), rest.summary)
    return replace(
        rest,
        verdict=verdict,
        summary=" ".join(sentences),
        candidates=_halved(rest.candidates, {effect.name: effect.probability for effect in others}),
        alternatives=_both(rest.alternatives, others, silent),
        indistinguishable=(*rest.indistinguishable, *((_noun(silent), effect.name) for effect in others)),
        findings=(*silent, *rest.findings),
    )


def _alone(logged: Diagnosis, silent: tuple[Finding, ...]) -> Diagnosis:
    """Nothing that could be explained or located is left: what does not answer is all that is said.

    Faults are the other reading only where they explain the log.
    """
    seen, readings = {}, (Alternative((), in_words(silent), 1.0),)
    if logged.verdict is Verdict.EXPLAINED:
        seen = {one.name: one.probability for one in logged.candidates}
        readings = doubted_alternatives(logged.alternatives, BELIEVED, in_words(silent))
    return replace(
        logged,
        verdict=Verdict.CANNOT_TELL,
        summary=" ".join(_sentence(finding.sentence) for finding in silent),
        where=Where(),
        effects=(),
        candidates=_halved((), seen),
        alternatives=readings,
        indistinguishable=(),
        next_experiment=None,
        gap=_as_before(logged.gap),
        findings=(*silent, *logged.findings),
        windows=tuple(replace(window, after=window.before) for window in logged.windows),
    )


def _instead(effects: Sequence[FoundEffect], silent: Sequence[Finding]) -> tuple[str, ...]:
    """The other reading."""
    clauses = [f"{e.sentence.rstrip('.')} ({100 * BELIEVED * e.probability:.0f} %)" for e in effects]
    if not clauses:
        return ()
    return (f"Or else, as {_noun(silent)} alone would testify: {'; '.join(clauses)}.",)


def _noun(silent: Sequence[Finding]) -> str:
    return named({column for finding in silent for column in finding.columns})


def _sentence(clause: str) -> str:
    return f"{clause[:1].upper()}{clause[1:]}."


def _halved(candidates: Sequence[EffectProbability], others: dict[str, float]) -> tuple[EffectProbability, ...]:
    """Candidates with those of the other reading, each as probable as that reading leaves it."""
    found = {one.name: one for one in candidates}
    for name, probability in others.items():
        most = max(BELIEVED * probability, found[name].probability if name in found else 0.0)
        found[name] = EffectProbability(name, most)
    if others:
        unknown = found.get(UNKNOWN, EffectProbability(UNKNOWN, 0.0))
        found[UNKNOWN] = replace(unknown, probability=max(unknown.probability, 1 - BELIEVED))
    return tuple(sorted(found.values(), key=lambda one: -one.probability))


def _both(
    rest: Sequence[Alternative], others: Sequence[FoundEffect], silent: Sequence[Finding]
) -> tuple[Alternative, ...]:
    """What all other channels leave open, and the other reading, beside which a channel does not answer.

    Without another reading it does not answer in any case: that is said of a vehicle of which nothing else is wrong.
    """
    other = BELIEVED * min((effect.probability for effect in others), default=0.0)
    still = in_words(silent)
    found = []
    for one in rest:
        says_all = one.besides == OTHERS or not others and (one.effects or one.besides)
        besides = one.besides if says_all else " and ".join(filter(None, (one.besides, still)))
        found.append(replace(one, besides=besides, probability=(1 - other) * one.probability))
    if others:
        found.append(Alternative(tuple(effect.name for effect in others), "", other))
    return tuple(sorted(found, key=lambda one: -one.probability))


def _as_before(gap: Gap) -> Gap:
    """A gap of which nothing is closed."""

    def same(errors: Errors | None) -> Errors | None:
        return errors and replace(errors, after=errors.before)

    dof = {name: replace(errors, after=errors.before) for name, errors in gap.dof.items()}
    kinds = {kind: same(getattr(gap, kind)) for kind in ("position_m", "yaw_rad", "velocity")}
    return replace(gap, **kinds, dof=dof, closed=None, confirmed=None)
