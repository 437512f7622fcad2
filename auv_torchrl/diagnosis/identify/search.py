"""Which effects a log asks for: neighbours of an explanation, promised along the measured motion, fitted by simulation.

The search itself is that of :mod:`auv_torchrl.sysid.search`. A neighbour has one effect, or one value of an effect,
more; one less; or another effect in place of one. The reduced quadratic along the measured motion promises each
neighbour a log evidence, and those that promise most are simulated.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from auv_torchrl.diagnosis.identify.agreeing_sensor import follow_agreeing
from auv_torchrl.diagnosis.identify.declared import declared
from auv_torchrl.diagnosis.identify.explanation import Explanation, Knob
from auv_torchrl.diagnosis.identify.fit import (
    fit_along_motion,
    fit_by_simulation,
    fitted_on,
    measure_noise,
    reassess,
    rescued,
)
from auv_torchrl.diagnosis.identify.found import Found
from auv_torchrl.diagnosis.identify.judged import Base, Judged, leaves_much
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.screen import Field, moves_all
from auv_torchrl.diagnosis.identify.steps import bounded_step, change_of_chi2, take_step
from auv_torchrl.diagnosis.thresholds import (
    CLOSES,
    CONTENDS,
    DOUBTED,
    DOUBTED_SHARE,
    FAR_BEHIND,
    FITTED_FROM,
    HOPELESS,
    LOOKED_ALONG,
    MANY_WINDOWS,
    MOST_EFFECTS,
    NEAR,
    REFITTED,
    SEARCHED_WINDOWS,
    SETTLED,
    SIMULATED,
    WORTH_AN_EFFECT,
)
from auv_torchrl.effects import EFFECTS
from auv_torchrl.sysid.search import Proposal, Search, Way
from auv_torchrl.sysid.trace import Outcome, Record

Progress = Callable[[str, float], None]
Key = tuple[tuple[str, tuple[str, ...], float], ...]


def search(
    problem: Problem, follow: Base, progress: Progress, begin: Sequence[Explanation] = (), further: bool = True
) -> Found:
    """The explanation with the highest posterior, and all that were looked at on the way to it.

    What acts shows in a part of a long log: some of its windows are searched, and what is found is fitted to all.

    Args:
        problem: a log that was followed.
        follow: its measured motion.
        progress: called with each step in words and the share of the work behind it.
        begin: explanations that are simulated first.
        further: whether effects are added and exchanged, too.
    """
    if len(problem.windows) <= MANY_WINDOWS:
        return _EffectSearch(problem, follow, progress).run(begin, further)
    rows = np.linspace(0, len(problem.windows) - 1, SEARCHED_WINDOWS).astype(int)
    few = Problem.of(problem.given.subset(rows), problem.vehicle, problem.settings, problem.known)
    found = _EffectSearch(*follow_agreeing(few), progress).run(begin, further)
    ranked = [found.best, *(one for one in found.fits if one is not found.best)]
    chosen = [one.explanation for one in ranked if one.explanation.effects][: 1 + REFITTED]
    whole = _EffectSearch(problem, follow, progress).run(chosen, further=False)
    names = whole.trace.best.names
    if names == found.trace.best.names or not any(one.simulated and one.names == names for one in found.trace.records):
        return replace(whole, trace=found.trace if names == found.trace.best.names else whole.trace)
    return replace(whole, trace=found.trace.instead(names, Outcome.STEP))


@dataclass(frozen=True)
class Neighbour:
    """An explanation to fit, and the windows from which its fit begins."""

    explanation: Explanation
    base: Base

    @property
    def key(self) -> Key:
        """Which values it sets, whatever they are."""
        return key_of(self.explanation)


class _EffectSearch(Search[Neighbour, Judged]):
    """A search for effects on its way."""

    def __init__(self, problem: Problem, follow: Base, progress: Progress) -> None:
        super().__init__()
        self._problem, self._follow, self._progress = problem, follow, progress
        self._tried: dict[Key, list[float]] = {}  # log posteriors of the fits of each explanation
        self._field = Field.of(problem, follow)

    def run(self, begin: Sequence[Explanation], further: bool) -> Found:
        """From no effect, or the best of those to begin with, to the best explanation."""
        self._progress("screening effects", 0.4)
        self.ways = (Way.LARGER, Way.SMALLER, Way.EXCHANGED) if further else (Way.SMALLER,)
        best = self.note(self._without_effects(), "the beginning")
        own = [self._follow.explanation] if self._follow.explanation.effects else []
        for explanation in (*own, *(one for one in begin if one not in own)):
            given = self._fitted(Neighbour(explanation, self._follow))
            best = max(best, self.note(given, "given to begin with"), key=self.posterior)
        if further and best.explanation.effects and leaves_much(self._problem, best):
            alone = self.better(Way.LARGER, self.fits[0])
            best = max(best, alone or best, key=self.posterior)
        best = self._by_plainer_names(self.climb(self.settle(best)))
        nothing = [one for one in self.fits if not one.explanation.effects]
        none, trace = max(nothing, key=self.posterior), self.trace(best)
        self._problem.freedoms.clear()
        ranked = sorted(self.fits, key=lambda one: -one.evidence)
        fits = tuple(one if one is best or one is none else one.set_aside() for one in ranked)
        return Found(self._problem, self._follow, none, best, fits, self._field, trace)

    def neighbours(self, way: Way, best: Judged) -> Sequence[Proposal[Neighbour]]:
        """See :meth:`Search.neighbours`."""
        self._progress("comparing explanations", min(0.9, 0.45 + 0.02 * len(self.fits)))
        for place, one in enumerate(self.fits):  # slopes of what is far behind would fill the memory
            if one.explanation.effects and self.posterior(one) < self.posterior(best) - CONTENDS:
                self.fits[place] = one.set_aside()
        ways = {Way.LARGER: self._larger, Way.SMALLER: self._smaller, Way.EXCHANGED: self._exchanged}
        return ways[way](best)

    def fit(self, proposal: Proposal[Neighbour], best: Judged) -> Judged:
        """See :meth:`Search.fit`; what comes near the best is fitted to the end before the two are compared."""
        fitted = self._fitted(proposal.what)
        near = self.posterior(best) - CONTENDS < self.posterior(fitted) < self.posterior(best)
        contends = near and not leaves_much(self._problem, best)
        return fitted_on(self._problem, fitted) if contends else fitted

    def record(self, fitted: Judged, proposed: str, outcome: Outcome) -> Record:
        """See :meth:`Search.record`."""
        return self._record(fitted.explanation, fitted.evidence, fitted.excess, proposed, outcome)

    def settled(self, best: Judged) -> Judged:
        """See :meth:`Search.settled`; what leaves much is on its way to a larger explanation.

        The noise is measured again under an explanation that leaves little.
        """
        if leaves_much(self._problem, best):
            return best
        fitted = fitted_on(self._problem, best)
        anew = measure_noise(self._problem, fitted)
        return fitted if anew is self._problem else self._under_other_noise(anew, best, fitted)

    def _without_effects(self) -> Judged:
        """No effect; where an effect promises far more, the nuisance parameters need not be fitted."""
        problem, none, numbers = self._problem, self._field.none(), self._field.quadratic.numbers
        first = max((one.evidence for one in self._field.families()), default=-np.inf)
        hopeless = none.evidence < first - HOPELESS and none.chi2 > NEAR * numbers
        fitted = fit_by_simulation(problem, Explanation(), self._follow, rounds=0 if hopeless else 4)
        return fitted if hopeless else rescued(problem, fitted, self._follow)

    def _fitted(self, what: Neighbour) -> Judged:
        enough = FAR_BEHIND * min(one.chi2 for one in self.fits)
        fitted = fit_by_simulation(self._problem, what.explanation, what.base, enough=enough)
        fitted = rescued(self._problem, fitted, self._follow, enough)
        self._tried.setdefault(what.key, []).append(self.posterior(fitted))
        return fitted

    def _is_known(self, proposal: Proposal[Neighbour]) -> bool:
        """Whether an explanation was fitted before, and promises no more now; fits from elsewhere may end higher."""
        before = self._tried.get(proposal.what.key, [])
        return len(before) >= FITTED_FROM or _promised(proposal) < max(before, default=-np.inf) + SETTLED

    def _doubt(self, best: Judged) -> float:
        """Log evidence that a linear prediction about a fit may be too low by: more where the fit leaves much."""
        return DOUBTED + DOUBTED_SHARE * max(0.0, best.chi2 - best.quadratic.numbers) / 2

    def _larger(self, best: Judged) -> list[Proposal[Neighbour]]:
        """With one effect, or one value of an effect, more: as promised about the best fit and the measured motion."""
        problem, mine = self._problem, set(best.explanation.effects)
        if len(mine) >= MOST_EFFECTS:
            return []
        fields = [(Field.of(problem, best.base), best.base)] if mine else [(self._field, self._follow)]
        if mine and leaves_much(problem, best):
            fields.append((Field.of(problem, self._follow, best.explanation), self._follow))
        promised: dict[Key, Proposal[Neighbour]] = {}
        for field, base in fields:
            here = field.none().evidence
            for one in field.families():
                what, added = Neighbour(one.explanation, base), set(one.explanation.effects) - mine
                if self._are_twins(added, mine):
                    continue
                how = f"with {_words(added)}" if added else "with more values of what is there"
                proposal = self._proposal(what, best, one.evidence - here, one.chi2, how)
                if self._is_known(proposal):
                    continue
                if what.key not in promised or _promised(proposal) > _promised(promised[what.key]):
                    promised[what.key] = proposal
        ranked = sorted(promised.values(), key=_promised, reverse=True)
        least = self.posterior(best) - self._doubt(best)
        likely = [one for one in ranked if _promised(one) > least]
        if leaves_much(problem, best) and len(likely) > SIMULATED:
            likely = [*self._looked_along(likely[:LOOKED_ALONG]), *likely[LOOKED_ALONG:]]
        chosen = [one.what.key for one in likely[:SIMULATED]]
        rest = [one for one in ranked if one.what.key not in chosen]
        return [*likely[:SIMULATED], *(replace(one, simulate=False) for one in rest)]

    def _looked_along(self, proposals: list[Proposal[Neighbour]]) -> list[Proposal[Neighbour]]:
        """Proposals with their values fitted along the measured motion, the likeliest first."""
        fits = [fit_along_motion(self._problem, one.what.explanation, self._follow) for one in proposals]
        found = [
            (fitted.evidence, replace(one, what=replace(one.what, explanation=fitted.explanation.alone)))
            for fitted, one in zip(fits, proposals, strict=True)
        ]
        return [one for _, one in sorted(found, key=lambda pair: -pair[0])]

    def _smaller(self, best: Judged) -> list[Proposal[Neighbour]]:
        """Without one value or one effect, unless the quadratic of the best fit excludes that."""
        knobs, here = best.explanation.knobs, self.posterior(best)
        parts: set[tuple[int, ...]] = {(place,) for place in range(len(knobs))}
        parts |= {tuple(p for p, knob in enumerate(knobs) if knob.effect == name) for name in best.explanation.effects}
        found: dict[tuple[int, ...], Proposal[Neighbour]] = {one: self._without(best, one) for one in sorted(parts)}
        together: tuple[int, ...] = ()  # what may go at once, the least needed first
        for places in sorted(found, key=lambda places: -_promised(found[places])):
            if _promised(found[places]) > here:
                more: tuple[int, ...] = tuple(sorted({*together, *places}))
                found[more] = self._without(best, more)
                together = more if _promised(found[more]) > here else together
        proposals = [found[together]] if len(together) > 1 else list(found.values())
        proposals += self._merged(best)
        least = here - self._doubt(best)
        likely = [one for one in proposals if _promised(one) > least and not self._is_known(one)]
        return sorted(likely, key=_promised, reverse=True)[:SIMULATED]

    def _without(self, best: Judged, places: tuple[int, ...]) -> Proposal[Neighbour]:
        """Without the values at some places of the best fit."""
        knobs = best.explanation.knobs
        nominal = [declared(knob.effect, self._problem.vehicle).nominal[knob.members[0]] for knob in knobs]
        moved, rise = held_at(self._problem, best, {place: nominal[place] for place in places})
        kept = tuple(knob for place, knob in enumerate(moved.knobs) if place not in places)
        gone = [f"{knobs[place].effect} {knobs[place].members[0]}" for place in places]
        how = f"without {_words(gone) if len(gone) < 3 else f'{len(gone)} values'}"
        return self._fewer(best, Explanation(kept, moved.slack), rise, how)

    def _merged(self, best: Judged) -> list[Proposal[Neighbour]]:
        """With one value for all members of a family of which most have a value of their own."""
        found, knobs = [], best.explanation.knobs
        whole = [atom for atom in self._problem.atoms if moves_all(self._problem, atom)]
        for effect, members in dict.fromkeys((atom.effect, tuple(atom.values)) for atom in whole):
            own = [p for p, knob in enumerate(knobs) if knob.effect == effect and set(knob.members) < set(members)]
            if 2 * len(own) <= len(members):
                continue
            shared = float(np.median([knobs[place].value for place in own]))
            moved, rise = held_at(self._problem, best, dict.fromkeys(own, shared))
            others = tuple(knob for place, knob in enumerate(moved.knobs) if place not in own)
            one = Explanation((*others, Knob(effect, members, shared)), moved.slack)
            found.append(self._fewer(best, one, rise, f"with one value for all of {_words([effect])}"))
        return found

    def _fewer(self, best: Judged, explanation: Explanation, rise: float, how: str) -> Proposal[Neighbour]:
        prior = self._problem.prior
        gain = prior.structure(explanation) - prior.structure(best.explanation) - 0.5 * rise
        return self._proposal(Neighbour(explanation, best.base), best, gain, best.chi2 + rise, how)

    def _exchanged(self, best: Judged) -> list[Proposal[Neighbour]]:
        """With the likeliest other effect in place of one of several."""
        effects, found = best.explanation.effects, []
        for effect in effects if len(effects) > 1 and not leaves_much(self._problem, best) else ():
            for one in Field.of(self._problem, best.base, best.explanation.without(effect)).families():
                what, added = Neighbour(one.explanation, best.base), set(one.explanation.effects) - set(effects)
                if not added or self._are_twins(added, (effect,)):
                    continue
                how = f"with {_words(added)} in place of {_words([effect])}"
                proposal = self._proposal(what, best, one.evidence - best.evidence, one.chi2, how)
                if not self._is_known(proposal):
                    likely = _promised(proposal) > self.posterior(best) - self._doubt(best)
                    found.append(replace(proposal, simulate=likely))
                break
        return found

    def _are_twins(self, added: Iterable[str], there: Iterable[str]) -> bool:
        """Whether an effect does to this log what one that is there does by another name."""
        return any(frozenset((new, old)) in self._field.twins for new in added for old in there)

    def _proposal(self, what: Neighbour, best: Judged, gain: float, chi2: float, how: str) -> Proposal[Neighbour]:
        misfit = chi2 / best.quadratic.numbers
        record = self._record(what.explanation, best.evidence + gain, misfit, how, Outcome.PREDICTED)
        return Proposal(what, record)

    def _record(
        self, explanation: Explanation, evidence: float, misfit: float, proposed: str, outcome: Outcome
    ) -> Record:
        """``evidence`` is that of the explanation with the prior of its structure."""
        structure = self._problem.prior.structure(explanation)
        values = explanation.values(self._problem.vehicle, slack=False)
        flat = {f"{effect}.{name}": value for effect, row in values.items() for name, value in row.items()}
        # An unknown effect is not to be pieced together from known ones: what is left weighs more, the more there are.
        left = CLOSES * max(0.0, misfit - 1.0) * self._field.quadratic.numbers / 2
        weight = structure - (WORTH_AN_EFFECT + left) * len(explanation.effects)
        names = tuple(sorted(explanation.effects))
        return Record(names, flat, evidence - structure, weight, misfit, proposed, outcome)

    def _under_other_noise(self, problem: Problem, noted: Judged, best: Judged) -> Judged:
        """The best explanation under another noise, and with it those that contend; all else changes by as much."""
        contend = [one for one in self.fits if self.posterior(one) > self.posterior(noted) - CONTENDS]
        self._problem, again = problem, reassess(problem, best)
        shift = again.evidence - best.evidence
        self.records = [replace(record, log_evidence=record.log_evidence + shift) for record in self.records]
        self._tried = {key: [before + shift for before in fits] for key, fits in self._tried.items()}
        for one in contend:
            if one is not noted and one.base.state.slope.size:
                self.exchange(one, reassess(problem, one))
        return again

    def _by_plainer_names(self, best: Judged) -> Judged:
        """The same vehicle where a value of one effect is one of a plainer effect, as no thrust limit is no gain."""
        tried = {atom.effect for atom in self._problem.atoms}

        def plainer(knob: Knob) -> Knob:
            same_as = EFFECTS[knob.effect].same_as
            same = [same_as(best.base.vehicle, member, knob.value) if same_as else None for member in knob.members]
            known = [one for one in same if one is not None and one[0] in tried]
            if len(known) < len(same):
                return knob
            return Knob(known[0][0], tuple(member for _, member, _ in known), known[0][2])

        knobs = tuple(plainer(knob) for knob in best.explanation.knobs)
        if knobs == best.explanation.knobs:
            return best
        renamed = fit_by_simulation(self._problem, replace(best.explanation, knobs=knobs), best.base)
        self.exchange(best, renamed)
        return renamed


def held_at(problem: Problem, judged: Judged, values: Mapping[int, float]) -> tuple[Explanation, float]:
    """An explanation with values, by place, held, all else moved as fits best, and by how much chi-square rises.

    The rise is that of its quadratic, from its minimum on; where a discrete value is among them, 0 is returned.
    """
    knobs = judged.explanation.knobs
    if any(knobs[place].discrete for place in values) or not np.isfinite(judged.chi2):
        return judged.explanation, 0.0
    order = {place: i for i, place in enumerate(p for p, knob in enumerate(knobs) if not knob.discrete)}
    first = len(problem.slack)
    held = {first + order[p]: (value - knobs[p].value) / judged.steps[order[p]] for p, value in values.items()}
    step = bounded_step(problem, judged, held)
    rise = change_of_chi2(problem, judged, *step) - change_of_chi2(problem, judged, *bounded_step(problem, judged))
    return take_step(problem, judged.explanation, *step), rise


def key_of(explanation: Explanation) -> Key:
    """Which values an explanation sets, whatever they are; those of discrete parameters count."""
    return tuple(sorted((*knob.key, knob.value if knob.discrete else 0.0) for knob in explanation.knobs))


def _promised(proposal: Proposal[Neighbour]) -> float:
    return proposal.promised.log_posterior


def _words(names: Iterable[str]) -> str:
    return " and ".join(sorted(names)).replace("_", " ")
