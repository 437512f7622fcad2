"""Which effects a log asks for: neighbours of an explanation, promised along the measured motion, fitted by simulation.

The search itself is that of :mod:`auv_torchrl.sysid.search`. A neighbour has one effect, or one value of an effect,
more; one less; or another effect in place of one. The reduced quadratic along the measured motion promises each
neighbour a log evidence, and those that promise most are simulated.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from auv_torchrl.diagnosis.identify.before_effects import follow_agreeing
from auv_torchrl.diagnosis.identify.explanation import Explanation, Term
from auv_torchrl.diagnosis.identify.fit import (
    fit_by_simulation,
    fitted_on,
    measure_noise,
    reassess,
)
from auv_torchrl.diagnosis.identify.hypotheses import plainer_names
from auv_torchrl.diagnosis.identify.neighbours import Key, Neighbour, Neighbourhood, promise, weighed
from auv_torchrl.diagnosis.identify.paths import Fit, WindowPath, leaves_much, nuisance_does, sizes
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.screen import Field
from auv_torchrl.diagnosis.identify.sure import likeliest
from auv_torchrl.diagnosis.thresholds import (
    CLOSES,
    CONTENDS,
    FAR_BEHIND,
    FAULT_KNOWN,
    FITTED_FROM,
    HOPELESS,
    MANY_WINDOWS,
    MINOR,
    NEAR,
    REFITTED,
    SEARCHED_WINDOWS,
    SETTLED,
)
from auv_torchrl.effects import EFFECTS
from auv_torchrl.sysid.search import Proposal, Search, Way
from auv_torchrl.sysid.trace import Outcome, Record, SearchTrace


@dataclass(frozen=True)
class Found:
    """The explanations of a log that were simulated, the best of them, and what they rest on."""

    problem: Problem  # with the sensor noise that was found
    follow: WindowPath  # nominal vehicle, the gap in a free force
    none: Fit
    best: Fit
    fits: tuple[Fit, ...]  # all that were simulated, the highest evidence first
    field: Field  # responses to all changes at the nominal vehicle
    trace: SearchTrace

    @property
    def excess(self) -> float:
        """Chi-square per measured number that the best explanation leaves; 1 is noise alone."""
        return self.best.excess

    @property
    def most_left(self) -> float:
        """Chi-square per number that an explanation may leave: what physics and the model of a fault are wrong by."""
        gap = self.field.none().chi2 / max(self.field.quadratic.numbers, 1) - self.excess
        does = max(gap, 0.0) if self.best.explanation.effects else 0.0
        return self.problem.settings.excess + FAULT_KNOWN**2 * does

    @cached_property
    def excess_as_stated(self) -> float:
        """The same under the floor of the settings, where the log's own, which may hide a gap, was searched with.

        A floor that healthy flights show is that of a sound vehicle, and stays.
        """
        problem = self.problem
        if problem.known is None or not problem.known.of_itself:
            return self.excess
        stated = np.array(problem.settings.floor_force)[problem.layout.dof]
        fit = reassess(replace(problem, floor=stated), self.best)
        return fit.excess


Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Unknown:
    """Log evidence of something unknown along a measured motion, which effects must promise more than."""

    at_first: float = -np.inf  # before any effect was simulated
    later: float = -np.inf


def outdoes(unknown: float, best: Fit) -> bool:
    """Whether something unknown, by its log evidence, closes as much of what a fit leaves as one more effect had to."""
    return unknown > best.evidence + CLOSES * max(0.0, best.chi2 - best.quadratic.numbers) / 2


def nothing_unknown(problem: Problem, follow: WindowPath) -> Unknown:
    """That nothing but effects may explain a log."""
    return Unknown()


def search(
    problem: Problem,
    follow: WindowPath,
    progress: Progress,
    begin: Sequence[Explanation] = (),
    further: bool = True,
    unknown: Callable[[Problem, WindowPath], Unknown] = nothing_unknown,
) -> Found:
    """The explanation with the highest posterior, and all that were tried on the way to it.

    What acts shows in a part of a long log: some of its windows are searched, and what is found is fitted to all.

    Args:
        problem: a log that was followed.
        follow: its measured motion.
        progress: called with each step in words and the share of the work behind it.
        begin: explanations that are simulated first.
        further: whether effects are added and exchanged, too.
        unknown: what effects that are added must promise more than.
    """
    if len(problem.windows) <= MANY_WINDOWS:
        return _EffectSearch(problem, follow, progress, unknown(problem, follow)).run(begin, further)
    rows = np.linspace(0, len(problem.windows) - 1, SEARCHED_WINDOWS).astype(int)
    few = Problem.of(problem.given.subset(rows), problem.vehicle, problem.settings, problem.known)
    few, its_follow = follow_agreeing(few)
    found = _EffectSearch(few, its_follow, progress, unknown(few, its_follow)).run(begin, further)
    ranked = [found.best, *(one for one in found.fits if one is not found.best)]
    chosen = [one.explanation for one in ranked if one.explanation.effects][: 1 + REFITTED]
    trace = found.trace  # that of the search among some windows, where all effects were tried
    del few, its_follow, found, ranked  # beside all windows they would fill the memory
    whole = _EffectSearch(problem, follow, progress).run(chosen, further=False)
    names, trace = whole.trace.best.names, trace.weighed_again(whole.trace)
    if names == trace.best.names:
        return replace(whole, trace=trace)
    is_there = any(record.simulated and record.names == names for record in trace.records)
    return replace(whole, trace=trace.instead(names, Outcome.STEP)) if is_there else whole


class _EffectSearch(Search[Neighbour, Fit]):
    """A search for effects on its way."""

    def __init__(self, problem: Problem, follow: WindowPath, progress: Progress, unknown: Unknown = Unknown()) -> None:
        super().__init__()
        self._unknown = unknown
        self._problem, self._follow, self._progress = problem, follow, progress
        self._tried: dict[Key, list[float]] = {}  # log posteriors of the fits of each explanation
        self._field = Field.of(problem, follow)
        self._is_noise_measured = False

    def run(self, begin: Sequence[Explanation], further: bool) -> Found:
        """From no effect, or the best of those to begin with, to the best explanation."""
        self._progress("screening effects", 0.4)
        self.ways = (Way.LARGER, Way.SMALLER, Way.EXCHANGED) if further else (Way.SMALLER,)
        best = self.note(self._without_effects(), "the beginning")
        own = [self._follow.explanation] if self._follow.explanation.effects else []
        for explanation in (*own, *(one for one in begin if one not in own)):
            given = self.note(self._fitted(Neighbour(explanation, self._follow)), "given to begin with")
            if not self.is_small(given):
                best = max(best, given, key=self.posterior)
        if further and best.explanation.effects and leaves_much(self._problem, best):
            alone = self.better(Way.LARGER, self.fits[0])
            best = max(best, alone or best, key=self.posterior)
        best = self.climb(self.settle(best))
        if not best.explanation.effects and not best.explanation.nuisance:  # nothing else kept what it promised
            self.exchange(best, fitted := fit_by_simulation(self._problem, Explanation(), self._follow))
            outdone = any(record.outcome is Outcome.OUTDONE for record in self.records)
            best = self.settle(fitted) if outdone else self.climb(self.settle(fitted))
        if further and best.explanation.effects and leaves_much(self._problem, best):
            best = self._begun_elsewhere(best)
        best = self._without_small(self._named_plainly(best))
        nothing = [one for one in self.fits if not one.explanation.effects]
        none, trace = max(nothing, key=self.posterior), self.trace(best)
        self._problem.freedoms.clear()
        ranked = sorted(self.counted, key=lambda one: -one.evidence)
        fits = tuple(one if one is best or one is none else one.set_aside() for one in ranked)
        return Found(self._problem, self._follow, none, best, fits, self._field, trace)

    def _begun_elsewhere(self, best: Fit) -> Fit:
        """The best that is reached from another single effect than the climb began with, by its likeliest partner.

        What explains most alone need not be a part of the truth: of two faults, a third effect may imitate both.
        """
        alone = [one for one in self.fits if len(one.explanation.effects) == 1]
        ranked = sorted(alone, key=self.posterior, reverse=True)
        each = {one.explanation.effects: one for one in reversed(ranked)}  # the likeliest fit of each effect
        here = self.posterior(best)
        least = here - self._around(best, here).doubt
        pairs = [self._around(one, here).along()[:1] for one in ranked[1:] if one is each[one.explanation.effects]]
        likely = [pair for pair, *_ in filter(None, pairs) if promise(pair) > least]
        fitted = [(self.fit(pair, best), pair.promised.proposed) for pair in likely]
        winner = max((one for one, _ in fitted if not self.is_small(one)), key=self.posterior, default=best)
        is_better = self.posterior(winner) > here
        for one, proposed in fitted:
            self.note(one, proposed, Outcome.STEP if is_better and one is winner else Outcome.NO_GAIN)
        return self.climb(self.settle(winner)) if is_better else best

    def _around(self, best: Fit, here: float) -> Neighbourhood:
        """The neighbourhood of a fit, whose neighbours must promise a log posterior."""
        # No effect leaves less along the measured motion than where it is simulated, and effects that explain the same.
        if best.explanation.effects:
            unknown = here + self._unknown.later - best.evidence
        else:
            unknown = here + self._unknown.at_first - self._field.none().evidence
        return Neighbourhood(self._problem, self._follow, self._field, best, here, self._is_known, unknown)

    def neighbours(self, way: Way, best: Fit) -> Sequence[Proposal[Neighbour]]:
        """See :meth:`Search.neighbours`."""
        self._progress("comparing explanations", min(0.9, 0.45 + 0.02 * len(self.fits)))
        for place, one in enumerate(self.fits):  # slopes of what is far behind would fill the memory
            if one.explanation.effects and self.posterior(one) < self.posterior(best) - CONTENDS:
                self.fits[place] = one.set_aside()
        if way is Way.SMALLER and outdoes(self._unknown.later, best):  # no smaller part of it will be named
            return []
        around = self._around(best, self.posterior(best))
        return {Way.LARGER: around.larger, Way.SMALLER: around.smaller, Way.EXCHANGED: around.exchanged}[way]()

    def fit(self, proposal: Proposal[Neighbour], best: Fit) -> Fit:
        """See :meth:`Search.fit`; what comes near the best is fitted to the end before the two are compared."""
        fitted = self._fitted(proposal.what)
        near = self.posterior(best) - CONTENDS < self.posterior(fitted) < self.posterior(best)
        contends = near and not leaves_much(self._problem, best)
        return fitted_on(self._problem, fitted) if contends else fitted

    def record(self, fitted: Fit, proposed: str, outcome: Outcome) -> Record:
        """See :meth:`Search.record`."""
        worth = fitted.evidence, fitted.excess
        return weighed(self._problem, self._field, fitted.explanation, *worth, proposed, outcome)

    def is_small(self, fitted: Fit) -> bool:
        """See :meth:`Search.is_small`: by the force of each effect beside that of nuisance parameters."""
        if not fitted.explanation.effects or not np.isfinite(fitted.chi2):
            return False
        sound = any(not one.explanation.effects and nuisance_does(self._problem, one) for one in self.fits)
        terms, effects = likeliest(self._problem, fitted).terms, fitted.explanation.effects
        each = [[term for term in terms if term.effect == effect] for effect in effects]
        return sound and bool(_are_small(self._problem, each, fitted.path).any())

    def settled(self, best: Fit) -> Fit:
        """See :meth:`Search.settled`; a vehicle without effects that leaves much is on its way to one with some.

        The noise is measured again under the first explanation that leaves little, and not again under every further
        one: whoever explains more would have less noise to explain.
        """
        if leaves_much(self._problem, best):
            return fitted_on(self._problem, best) if best.explanation.effects else best
        fitted = fitted_on(self._problem, best)
        anew = measure_noise(self._problem, fitted) if not self._is_noise_measured else self._problem
        self._is_noise_measured = True
        return fitted if anew is self._problem else self._under_other_noise(anew, best, fitted)

    def _without_effects(self) -> Fit:
        """No effect; where an effect promises to leave less than half, the nuisance parameters need not be fitted."""
        problem, none, numbers = self._problem, self._field.none(), self._field.quadratic.numbers
        least = min((one.chi2 for one in self._field.families()), default=np.inf)
        hopeless = least < HOPELESS * none.chi2 and none.chi2 > NEAR * numbers
        return fit_by_simulation(problem, Explanation(), self._follow, rounds=0 if hopeless else 4)

    def _fitted(self, what: Neighbour) -> Fit:
        enough = FAR_BEHIND * min(one.chi2 for one in self.fits)
        fitted = fit_by_simulation(self._problem, what.explanation, what.path, enough=enough)
        self._tried.setdefault(what.key, []).append(self.posterior(fitted))
        return fitted

    def _is_known(self, proposal: Proposal[Neighbour]) -> bool:
        """Whether an explanation was fitted before, and promises no more now; fits from elsewhere may end higher."""
        before = self._tried.get(proposal.what.key, [])
        return len(before) >= FITTED_FROM or promise(proposal) < max(before, default=-np.inf) + SETTLED

    def _under_other_noise(self, problem: Problem, noted: Fit, best: Fit) -> Fit:
        """The best explanation under another noise, and with it those that contend; all else changes by as much."""
        contend = [one for one in self.fits if self.posterior(one) > self.posterior(noted) - CONTENDS]
        self._problem, again = problem, reassess(problem, best)
        shift = again.evidence - best.evidence
        self.records = [replace(record, log_evidence=record.log_evidence + shift) for record in self.records]
        self._tried = {key: [before + shift for before in fits] for key, fits in self._tried.items()}
        for one in contend:
            if one is not noted and one.path.state.slope.size:
                self.exchange(one, reassess(problem, one))
        return again

    def _named_plainly(self, best: Fit) -> Fit:
        """The same vehicle by plainer names, as a thrust limit of 0 is a gain of 0, less what these make needless."""
        tried = {candidate.effect for candidate in self._problem.candidates}

        def plainer(term: Term) -> Term:
            values = ((member, term.value) for member in term.members)
            known = plainer_names(EFFECTS[term.effect], best.path.vehicle, values, tried)
            if known is None:
                return term
            return Term(known[0][0], tuple(member for _, member, _ in known), known[0][2])

        terms = tuple(plainer(term) for term in best.explanation.terms)
        if terms == best.explanation.terms:
            return best
        renamed = fit_by_simulation(self._problem, replace(best.explanation, terms=terms), best.path)
        self.exchange(best, renamed)
        self._tried.clear()  # what is smaller was tried beside other names
        self.ways = (Way.SMALLER,)
        return self.climb(renamed)

    def _without_small(self, best: Fit) -> Fit:
        """The same less all values at once whose force is small, if that is likelier.

        Where chi-square is rough, small values of other thrusters settle on its dents, and each by itself looks needed.
        """
        if outdoes(self._unknown.later, best):
            return best
        terms = best.explanation.terms
        small = _are_small(self._problem, [[term] for term in terms], best.path)
        places = [place for place, is_small in enumerate(small) if is_small and not terms[place].discrete]
        if len(places) < 2 or len(places) == len(terms):
            return best
        less = self._around(best, self.posterior(best)).less(places)
        fitted = self.fit(less, best)
        is_better = self.posterior(fitted) > self.posterior(best)
        self.note(fitted, less.promised.proposed, Outcome.FEWER if is_better else Outcome.NEEDED)
        return self.settle(fitted) if is_better else best


def _are_small(problem: Problem, each: Sequence[Sequence[Term]], path: WindowPath) -> np.ndarray:
    """Which terms, taken together, make a force that is small beside that of nuisance parameters."""
    made = sizes(problem, [Explanation(tuple(terms)) for terms in each], path)
    small: np.ndarray = made < MINOR * problem.nuisance_size
    return small
