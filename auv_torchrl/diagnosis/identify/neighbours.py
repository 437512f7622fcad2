"""Neighbours of an explanation: which there are, and what the reduced quadratic promises of each.

A neighbour has one effect, or some values of an effect, more; some values or an effect less; another effect in place of
one; or plugs in place of several effects of single thrusters.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from auv_torchrl.diagnosis.identify.assess import bounded_step, change_of_chi2, take_step
from auv_torchrl.diagnosis.identify.explanation import Explanation, Term, giver_of, rings
from auv_torchrl.diagnosis.identify.fit import fit_along_motion
from auv_torchrl.diagnosis.identify.hypotheses import declared
from auv_torchrl.diagnosis.identify.paths import Fit, WindowPath, leaves_much
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.routing import propose_routing
from auv_torchrl.diagnosis.identify.screen import Field, Screened
from auv_torchrl.diagnosis.thresholds import (
    CLOSES,
    DOUBTED,
    DOUBTED_SHARE,
    FITTED_ALONG,
    SIMULATED,
    WORTH_AN_EFFECT,
)
from auv_torchrl.effects import EFFECTS
from auv_torchrl.quantities import counted
from auv_torchrl.sysid.search import Proposal
from auv_torchrl.sysid.trace import Outcome, Record

Key = tuple[tuple[str, tuple[str, ...], float], ...]


@dataclass(frozen=True)
class Neighbour:
    """An explanation to fit, and the windows from which its fit begins."""

    explanation: Explanation
    path: WindowPath

    @property
    def key(self) -> Key:
        """Which values it sets, whatever they are; those of discrete parameters count."""
        terms = self.explanation.terms
        return tuple(sorted((*term.key, term.value if term.discrete else 0.0) for term in terms))


@dataclass(frozen=True)
class Neighbourhood:
    """The neighbours of the best fit so far."""

    problem: Problem
    follow: WindowPath  # the measured motion
    field: Field  # responses to all changes along it, without an effect
    best: Fit
    here: float  # its log posterior
    is_known: Callable[[Proposal[Neighbour]], bool]  # whether a proposal was fitted before, and promises no more
    unknown: float = -np.inf  # log posterior of something unknown, which effects must promise more than

    @property
    def doubt(self) -> float:
        """Log evidence that a linear prediction may be too low by: more where much is left where it is made."""
        left = self.best.chi2 if self.best.explanation.effects else min(self.best.chi2, self.field.constant)
        return DOUBTED + DOUBTED_SHARE * max(0.0, left - self.best.quadratic.numbers) / 2

    def larger(self) -> list[Proposal[Neighbour]]:
        """With one effect, or one value of an effect, more: as promised about the best fit and the measured motion."""
        problem, mine = self.problem, set(self.best.explanation.effects)
        if len(mine) >= problem.settings.most_effects:
            return []
        fields = [(Field.of(problem, self.best.path), self.best.path)] if mine else [(self.field, self.follow)]
        if mine and leaves_much(problem, self.best):
            fields.append((Field.of(problem, self.follow, self.best.explanation), self.follow))
        promised = self._promised(fields)
        for proposal in self._plugged(fields[-1][0]):
            if not self.is_known(proposal):
                promised[proposal.what.key] = proposal
        ranked = sorted(promised.values(), key=promise, reverse=True)
        least = max(self.here, self.unknown) - self.doubt
        likely = [one for one in ranked if promise(one) > least]
        if leaves_much(problem, self.best):
            likely = [*self._fitted_along(likely[:FITTED_ALONG]), *likely[FITTED_ALONG:]]
        chosen = [one.what.key for one in likely[:SIMULATED]]
        rest = [self._left_out(one) for one in ranked if one.what.key not in chosen]
        return [*likely[:SIMULATED], *rest]

    def along(self) -> list[Proposal[Neighbour]]:
        """With one effect more, as promised about the measured motion alone; of a fit whose slopes were let go, too."""
        field = Field.of(self.problem, self.follow, self.best.explanation)
        return sorted(self._promised([(field, self.follow)]).values(), key=promise, reverse=True)

    def _promised(self, fields: Sequence[tuple[Field, WindowPath]]) -> dict[Key, Proposal[Neighbour]]:
        """What the candidates of each field promise, where no fit of them promised more before."""
        mine, promised = set(self.best.explanation.effects), dict[Key, Proposal[Neighbour]]()
        for field, path in fields:
            here = field.none().evidence
            for one in field.families():
                what, added = Neighbour(one.explanation, path), set(one.explanation.effects) - mine
                how = f"with {_words(added)}" if added else "with more values of what is there"
                proposal = self._proposal(what, one.evidence - here, self._misfit(one), how)
                if self.is_known(proposal):
                    continue
                if what.key not in promised or promise(proposal) > promise(promised[what.key]):
                    promised[what.key] = proposal
        return promised

    def _left_out(self, one: Proposal[Neighbour]) -> Proposal[Neighbour]:
        """A proposal that is not simulated, and whether it is for the sake of something unknown."""
        outdone = self.here - self.doubt < promise(one) <= self.unknown - self.doubt
        return replace(
            one, simulate=False, promised=replace(one.promised, outcome=Outcome.OUTDONE) if outdone else one.promised
        )

    def _plugged(self, field: Field) -> list[Proposal[Neighbour]]:
        """With all plugs where the measured motion has them; none where the best fit leaves little."""
        if not leaves_much(self.problem, self.best):
            return []
        one = propose_routing(self.problem, self.follow, self.best.explanation)
        if (
            one is None
            or Neighbour(one.explanation, self.follow).key == Neighbour(self.best.explanation, self.follow).key
        ):
            return []
        gain = one.evidence - field.none().evidence
        what = Neighbour(one.explanation, self.follow)
        return [self._proposal(what, gain, self._misfit(one), "with the plugs as they act")]

    def _fitted_along(self, proposals: list[Proposal[Neighbour]]) -> list[Proposal[Neighbour]]:
        """Proposals with their values fitted along the measured motion, the likeliest first."""
        fits = [fit_along_motion(self.problem, one.what.explanation, self.follow) for one in proposals]
        found = [
            (fitted.evidence, replace(one, what=replace(one.what, explanation=fitted.explanation.alone)))
            for fitted, one in zip(fits, proposals, strict=True)
        ]
        return [one for _, one in sorted(found, key=lambda pair: -pair[0])]

    def smaller(self) -> list[Proposal[Neighbour]]:
        """Without one value or one effect, unless the quadratic excludes that.

        The quadratic of the best fit says nothing of discrete values: these go by themselves.
        """
        terms, here = self.best.explanation.terms, self.here
        parts = {tuple(places) for places in _inseparable(terms)}
        effects = self.best.explanation.effects
        parts |= {tuple(p for p, term in enumerate(terms) if term.effect == name) for name in effects}
        found: dict[tuple[int, ...], Proposal[Neighbour]] = {one: self.less(one) for one in sorted(parts)}
        untold = {places for places in found if any(terms[place].discrete for place in places)}
        together: tuple[int, ...] = ()  # what may go at once, the least needed first
        for places in sorted(found, key=lambda places: -promise(found[places])):
            if promise(found[places]) > here and places not in untold:
                more: tuple[int, ...] = tuple(sorted({*together, *places}))
                found[more] = self.less(more)
                together = more if promise(found[more]) > here else together
        told = [together] if len(together) > 1 else sorted(parts - untold)
        proposals = [found[places] for places in (*told, *sorted(untold))]
        least = here - self.doubt
        likely = [one for one in proposals if promise(one) > least and not self.is_known(one)]
        return sorted(likely, key=promise, reverse=True)[:SIMULATED]

    def less(self, places: Sequence[int]) -> Proposal[Neighbour]:
        """Without the values at some places of the best fit."""
        terms = self.best.explanation.terms
        smaller, rise = without(self.problem, self.best, places)
        gone = [f"{terms[place].effect} {terms[place].members[0]}" for place in places]
        how = f"without {_words(gone) if len(gone) < 3 else counted(len(gone), 'value')}"
        prior = self.problem.prior
        gain = prior.structure(smaller) - prior.structure(self.best.explanation) - 0.5 * rise
        misfit = (self.best.chi2 + rise) / self.best.quadratic.numbers  # of all windows, followed or not
        return self._proposal(Neighbour(smaller, self.best.path), gain, misfit, how)

    def exchanged(self) -> list[Proposal[Neighbour]]:
        """With the likeliest other effect in place of one of several, or with plugs in place of several."""
        effects, found = self.best.explanation.effects, []
        for effect in effects if len(effects) > 1 and not leaves_much(self.problem, self.best) else ():
            for one in Field.of(self.problem, self.best.path, self.best.explanation.without(effect)).families():
                what, added = Neighbour(one.explanation, self.best.path), set(one.explanation.effects) - set(effects)
                if not added:
                    continue
                how = f"with {_words(added)} in place of {_words([effect])}"
                proposal = self._proposal(what, one.evidence - self.best.evidence, self._misfit(one), how)
                if not self.is_known(proposal):
                    likely = promise(proposal) > self.here - self.doubt
                    found.append(replace(proposal, simulate=likely))
                break
        return [*found, *self._replugged()]

    def _replugged(self) -> list[Proposal[Neighbour]]:
        """With the plugs as they act in place of all that several effects say of single thrusters."""
        terms = self.best.explanation.terms
        of_thrusters = [term for term in terms if EFFECTS[term.effect].thruster_of(term.members[0])]
        if len({term.effect for term in of_thrusters}) < 2 or leaves_much(self.problem, self.best):
            return []
        rest = Explanation(tuple(term for term in terms if term not in of_thrusters))
        one = propose_routing(self.problem, self.best.path, rest)
        if one is None:
            return []
        what = Neighbour(one.explanation, self.best.path)
        how = "with the plugs as they act in place of what is said of single thrusters"
        proposal = self._proposal(what, one.evidence - self.best.evidence, self._misfit(one), how)
        return [proposal] if not self.is_known(proposal) and promise(proposal) > self.here - self.doubt else []

    def _misfit(self, promised: Screened) -> float:
        """Chi-square per number in the windows that are followed; 0 where no force makes the vehicle follow any."""
        return promised.chi2 / max(self.field.quadratic.numbers, 1)

    def _proposal(self, what: Neighbour, gain: float, misfit: float, how: str) -> Proposal[Neighbour]:
        evidence = self.best.evidence + gain
        record = weighed(self.problem, self.field, what.explanation, evidence, misfit, how, Outcome.PREDICTED)
        return Proposal(what, record)


def _inseparable(terms: Sequence[Term]) -> Iterator[list[int]]:
    """Places of values that can go alone: each by itself, those of exchanged plugs with their ring."""
    yield from ([place] for place, term in enumerate(terms) if not term.discrete)
    for effect in {term.effect for term in terms if term.discrete}:
        giver = giver_of([term for term in terms if term.effect == effect])
        places = {n: place for place, term in enumerate(terms) if term.effect == effect for n in giver_of([term])}
        yield from ([places[number] for number in ring if number in places] for ring in rings(giver))


def weighed(
    problem: Problem,
    field: Field,
    explanation: Explanation,
    evidence: float,
    misfit: float,
    proposed: str,
    outcome: Outcome,
) -> Record:
    """What an explanation is worth; ``evidence`` is its log evidence with the prior of its structure.

    ``field`` is that of no effect, whose chi-square is the size of the gap.
    """
    numbers, several = field.quadratic.numbers, max(0, _statements(problem, explanation) - 1)
    structure = problem.prior.structure(explanation)
    values = explanation.values(problem.vehicle, nuisance=False)
    flat = {f"{effect}.{name}": value for effect, row in values.items() for name, value in row.items()}
    # An unknown effect is not to be pieced together from known ones: what is left weighs more, the more there are.
    left = CLOSES * max(0.0, misfit - 1.0) * numbers / 2
    weight = structure - (WORTH_AN_EFFECT + left) * len(explanation.effects)
    # A vehicle repeats itself to a share of its own motion: what departs from a fault by no more is no second one.
    weight -= 0.5 * problem.repeating**2 * max(0.0, field.none().chi2 - misfit * numbers) * several
    names = tuple(sorted(explanation.effects))
    return Record(names, flat, evidence - structure, weight, misfit, proposed, outcome)


def _statements(problem: Problem, explanation: Explanation) -> int:
    """How many things an explanation says: one for an effect, or one for each member of a family that differs."""
    members = {term.key for term in explanation.terms if is_of_family(problem, term)}
    others = {term.effect for term in explanation.terms if not is_of_family(problem, term)}
    return len(members) + len(others)


def is_of_family(problem: Problem, term: Term) -> bool:
    """Whether a value is that of a member of a family, such as the gain of one thruster; numbers of plugs are not."""
    return not term.discrete and bool(declared(term.effect, problem.vehicle).parameters[term.members[0]].over)


def without(problem: Problem, fit: Fit, places: Collection[int]) -> tuple[Explanation, float]:
    """An explanation without the values at some places, as :func:`held_at` has it, and the rise of chi-square."""
    terms = fit.explanation.terms
    nominal = {p: declared(terms[p].effect, problem.vehicle).nominal[terms[p].members[0]] for p in places}
    moved, rise = held_at(problem, fit, nominal)
    return replace(moved, terms=tuple(term for p, term in enumerate(moved.terms) if p not in nominal)), rise


def held_at(problem: Problem, fit: Fit, values: Mapping[int, float]) -> tuple[Explanation, float]:
    """An explanation with values, by place, held, all else moved as fits best, and by how much chi-square rises.

    The rise is that of its quadratic, from its minimum on; where a discrete value is among them, 0 is returned.
    """
    terms = fit.explanation.terms
    if any(terms[place].discrete for place in values) or not np.isfinite(fit.chi2):
        return fit.explanation, 0.0
    order = {place: i for i, place in enumerate(p for p, term in enumerate(terms) if not term.discrete)}
    first = len(problem.nuisance)
    held = {first + order[p]: (value - terms[p].value) / fit.steps[order[p]] for p, value in values.items()}
    step = bounded_step(problem, fit, held)
    rise = change_of_chi2(problem, fit, *step) - change_of_chi2(problem, fit, *bounded_step(problem, fit))
    return take_step(problem, fit.explanation, *step), rise


def promise(proposal: Proposal[Neighbour]) -> float:
    """Log posterior that a neighbour is promised."""
    return proposal.promised.log_posterior


def _words(names: Iterable[str]) -> str:
    return " and ".join(sorted(names)).replace("_", " ")
