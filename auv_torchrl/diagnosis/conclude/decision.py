"""What is named of the best explanation, and how that was decided: what was tried, and why an effect is not named."""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.axes import unseen
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.paths import Fit
from auv_torchrl.diagnosis.identify.posterior import Member
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.search import Found
from auv_torchrl.diagnosis.identify.sure import as_sure
from auv_torchrl.diagnosis.motion.smooth import noise_per_sample
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import MODEL_ERROR, Z95
from auv_torchrl.diagnosis.verdict import NOT_SHOWN, Decision, Estimate, FoundEffect, Hypothesis
from auv_torchrl.effects import EFFECTS
from auv_torchrl.quantities import words
from auv_torchrl.sysid.trace import Outcome, Record, SearchTrace


def found_effects(
    problem: Problem,
    found: Found,
    probability: dict[str, float],
    closed: float | None,
    autopilot: Mapping[str, float],
) -> tuple[FoundEffect, ...]:
    """The effects of the best explanation with values, intervals, shares and advice, what closes most first.

    ``autopilot`` holds the parameters of the autopilot that the log tells.
    """
    shares = leave_one_out(found)
    explanation, covariance = as_sure(problem, found.best)
    effects = []
    for name in explanation.effects:
        share = None if closed is None else closed * shares[name]
        effect = _found_effect(problem, explanation, covariance, name, probability[name], share)
        values = {member: estimate.value for member, estimate in effect.parameters.items()}
        advice = EFFECTS[name].advise(problem.vehicle, values, autopilot)
        effects.append(replace(effect, advice=advice))
    listed = [effect for effect in effects if not is_ordinary(problem, effect)] or effects
    return tuple(sorted(listed, key=lambda effect: -(effect.gap_closed or 0.0)))


def is_ordinary(problem: Problem, effect: FoundEffect) -> bool:
    """Whether it is what clocks and filters of every vehicle are off by, in a log that a vehicle wrote."""
    declared = EFFECTS[effect.name].member_parameters(problem.vehicle)
    departs = {name: abs(e.value - e.nominal) for name, e in effect.parameters.items()}
    return problem.windows.errors.coloured and all(by <= declared[name].ordinary for name, by in departs.items())


def leave_one_out(found: Found) -> dict[str, float]:
    """Share of what the explanation closes that comes back when one effect is taken out."""
    best = found.best
    nothing = found.none.chi2
    if nothing <= best.chi2:
        return dict.fromkeys(best.explanation.effects, 0.0)
    shares = {}
    for name in best.explanation.effects:
        rest = set(best.explanation.effects) - {name}
        others = [j.chi2 for j in found.fits if set(j.explanation.effects) == rest]
        worse = min(others, default=nothing)
        shares[name] = float(np.clip((worse - best.chi2) / (nothing - best.chi2), 0.0, 1.0))
    return shares


def cannot_tell(problem: Problem, found: Found, hidden: frozenset[Member]) -> tuple[str, ...]:
    """What this log is silent about: effects and ``hidden`` parameters without a response, and values at a bound."""
    seen = {problem.candidates[i].effect for i in np.flatnonzero(found.field.seen)}
    blind = sorted({candidate.effect for candidate in problem.candidates} - seen)
    for effect in sorted({effect for effect, _ in hidden}):
        members = [name for name in EFFECTS[effect].member_parameters(problem.vehicle) if (effect, name) in hidden]
        blind.append(f"{effect} ({', '.join(members)})")
    filtered = [name for name, effect in EFFECTS.items() if not effect.trial.shows_in(problem.windows.errors.drift)]
    sentences = [
        *(f"{name} hides behind the filter of the autopilot" for name in filtered),
        *unseen(problem),
        *(f"{name} {NOT_SHOWN}" for name in blind),
    ]
    for term in found.best.explanation.fitted:
        p = EFFECTS[term.effect].member_parameters(problem.vehicle)[term.members[0]]
        nominal = EFFECTS[term.effect].nominal(problem.vehicle)[term.members[0]]
        if term.value in (p.low, p.high) and term.value != nominal:
            sentences.append(f"{term.effect}: {', '.join(term.members)} is at its bound {term.value:g} {p.unit}")
    return tuple(sentences)


def _found_effect(
    problem: Problem, explanation: Explanation, covariance: Floats, name: str, probability: float, closed: float | None
) -> FoundEffect:
    effect = EFFECTS[name]
    declared, nominal = effect.member_parameters(problem.vehicle), effect.nominal(problem.vehicle)
    values = explanation.values(problem.vehicle, nuisance=False)[name]  # where two terms move a member, both count
    values = {member: values[member] for member in declared if member in values}  # in the order of the thrusters
    parameters: dict[str, Estimate] = {}
    thrusters: set[int] = set()
    sentences = []
    for member, value in values.items():
        p = declared[member]
        moving = [i for i, k in enumerate(explanation.fitted) if k.effect == name and member in k.members]
        model = MODEL_ERROR * abs(value - nominal[member]) if moving else 0.0  # a discrete value has no error
        half = Z95 * float(np.hypot(np.sqrt(covariance[np.ix_(moving, moving)].sum()), model))
        low, high = max(p.low, value - half), min(p.high, value + half)
        parameters[member] = Estimate(value, low, high, nominal[member], p.unit)
        sentences.append(p.sentence_of(member, value))
        if p.over == "thruster":
            thrusters.add(int(member.removeprefix(f"{p.name}_")))
    if len(term_members := {k.members for k in explanation.terms if k.effect == name}) == 1:
        (members,) = term_members
        if len(members) > 1:
            sentences = [declared[members[0]].sentence_of_all(parameters[members[0]].value)]
    if effect.sentence is not None:
        sentences = [effect.sentence({member: value for member, value in values.items() if value != nominal[member]})]
    return FoundEffect(name, probability, parameters, tuple(sorted(thrusters)), closed, "; ".join(sentences))


FLEW_OFF = 1e3  # standard deviations, beyond which a window says nothing but that its simulation flew off
TELLS = 0.1  # of what tells two explanations apart, above which a channel is worth a word


def decide(found: Found, refuted: bool) -> Decision:
    """How a log was explained; ``refuted`` where held-out flight took the best explanation back."""
    trace = found.trace
    if refuted:
        trace = trace.instead((), Outcome.REFUTED)
    second = trace.runner_up
    fits = {tuple(sorted(fit.explanation.effects)): fit for fit in reversed(found.fits)}
    apart = {}
    if second is not None and second.names in fits and trace.best.names in fits:
        apart = speaks_by_channel(found, fits[trace.best.names], fits[second.names])
    return Decision(
        trace=tuple(_hypothesis(record) for record in trace.records),
        reasons=_reasons(found, trace),
        next_best="" if second is None else _hypothesis(second).called,
        apart=apart,
    )


def speaks_by_channel(found: Found, one: Fit, other: Fit) -> dict[str, float]:
    """By channel, the share of the samples' chi-square that speaks for one fit against another, most first."""
    windows, sigma = found.problem.windows, found.problem.sigma
    noise = noise_per_sample(windows, sigma)
    far = [(fit.path.state.residual / noise).reshape(windows.measured.shape) for fit in (one, other)]
    flown = np.maximum(*np.abs(far)).max((1, 2)) < FLEW_OFF  # NaN, too, where a window diverged
    speaks = np.maximum((far[1][flown] ** 2 - far[0][flown] ** 2).sum((0, 1)), 0.0)
    if not speaks.sum() > 0:
        return {}
    shares = dict(zip(windows.channels, (speaks / speaks.sum()).tolist(), strict=True))
    return dict(sorted(((c, s) for c, s in shares.items() if s > TELLS), key=lambda item: -item[1]))


def _reasons(found: Found, trace: SearchTrace) -> dict[str, str]:
    """By effect of the library, why it is named, or why it is not."""
    problem = found.problem
    recorded = {name for record in trace.records for name in record.names}
    tried = {candidate.effect for candidate in problem.candidates}
    reasons = {}
    for name, effect in EFFECTS.items():
        if name in recorded:
            reasons[name] = words(trace.why(name))
        elif name in problem.settings.left_out:
            reasons[name] = "not looked for"
        elif name in tried:
            reasons[name] = "no change of it shows in this log"
        elif not effect.trial.is_asked(problem.windows.channels):
            reasons[name] = "not looked for: the log measures nothing that would show it"
        else:
            reasons[name] = "not looked for: it changes nothing on this vehicle, or a filter of the autopilot hides it"
    return reasons


def _hypothesis(record: Record) -> Hypothesis:
    evidence, misfit = (value if math.isfinite(value) else None for value in (record.log_evidence, record.misfit))
    return Hypothesis(record.names, record.values, evidence, record.log_prior, misfit, record.proposed, record.outcome)
