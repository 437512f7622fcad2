"""Which changes of a model a log asks for: forward selection and backward elimination, by linear prediction and fit.

:func:`identify` is the whole way, from records of a system to the changes of its model.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from auv_torchrl.sysid.fit import PROBE, Fit, fit, least_quadratic, parameter_columns
from auv_torchrl.sysid.linear import Linearised, reduced_quadratic, sensitivities
from auv_torchrl.sysid.model import Floats, Model
from auv_torchrl.sysid.path import Path, Problem
from auv_torchrl.sysid.prior import Candidate, Hypothesis, Prior, log_prior
from auv_torchrl.sysid.search import Proposal, Search, Way
from auv_torchrl.sysid.smooth import follow, smooth
from auv_torchrl.sysid.trace import Outcome, Record, SearchTrace
from auv_torchrl.sysid.windows import Disturbance, Windows

FITTED_EACH_ROUND = 4  # candidates that are simulated in a round of forward selection, the best by linear prediction
DOUBTED = 1.0  # log units by which the linear prediction of a small change may be too low,
DOUBTED_SHARE = 0.1  # and share of the log likelihood that is missing: where much is left, slopes hold less far
MOST_AT_ONCE = 6  # candidates of a hypothesis: more than that is a file that is wrong, not faults


@dataclass(frozen=True)
class Selection:
    """What a search ends with."""

    problem: Problem
    best: Fit
    fits: tuple[Fit, ...]  # all that were simulated
    trace: SearchTrace


def select(
    problem: Problem,
    candidates: Sequence[Candidate],
    prior: Prior | None = None,
    begin: Fit | None = None,
    progress: Callable[[str], None] = lambda step: None,
) -> Selection:
    """Add what the log evidence gains most from, take away what it does not pay for, until neither helps.

    Args:
        problem: smoothed, so that its noise is known.
        candidates: changes to try.
        prior: of the nuisance parameters; by default independent, with their tolerances.
        begin: a fit under other noise, whose hypothesis is tried first; by default the search begins with nothing.
        progress: called with each step in words.
    """
    return _Search(problem, tuple(candidates), prior or Prior(problem.model, Hypothesis()), progress).run(begin)


class _Search(Search["Prediction", Fit]):
    """A search by the reduced quadratic about the motion that was measured."""

    def __init__(
        self, problem: Problem, candidates: tuple[Candidate, ...], prior: Prior, progress: Callable[[str], None]
    ) -> None:
        super().__init__()
        self._problem, self._candidates, self._prior, self._progress = problem, candidates, prior, progress
        self._measured = follow(problem, prior.center)

    def run(self, begin: Fit | None) -> Selection:
        """From nothing, or from a hypothesis, to the best one."""
        best = self.note(self._fitted(Hypothesis(), self._prior.center), "the beginning")
        if begin is not None and begin.names:
            self._measured = follow(self._problem, begin.values)
            again = self._fitted(begin.prior.hypothesis, begin.values)
            best = max(best, self.note(again, "the search under other noise"), key=self.posterior)
        best = self.climb(best)
        return Selection(self._problem, best, tuple(self.fits), self.trace(best))

    def neighbours(self, way: Way, best: Fit) -> Sequence[Proposal["Prediction"]]:
        """With one candidate more, or one less."""
        return self._larger(best) if way is Way.LARGER else self._smaller(best)

    def fit(self, proposal: Proposal["Prediction"], best: Fit) -> Fit:
        """See :meth:`Search.fit`."""
        what = proposal.what
        self._progress(f"trying {proposal.promised.called}")
        return self._fitted(what.hypothesis, what.values)

    def record(self, fitted: Fit, proposed: str, outcome: Outcome) -> Record:
        """See :meth:`Search.record`."""
        hypothesis = fitted.prior.hypothesis
        return self._worth(hypothesis, fitted.values, fitted.log_evidence, fitted.misfit, proposed, outcome)

    def settled(self, best: Fit) -> Fit:
        """The fit as it is; the motion is measured again under its values, for the rounds that follow."""
        self._measured = follow(self._problem, best.values, self._measured.path)
        return best

    def _larger(self, best: Fit) -> list[Proposal["Prediction"]]:
        """Hypotheses with one more candidate, a few of which are simulated."""
        hypothesis = best.prior.hypothesis
        if len(best.names) >= MOST_AT_ONCE:
            return []
        open_ones = [candidate for candidate in self._candidates if not hypothesis.overlaps(candidate)]
        # Slopes at far values say little about small changes, and the other way round: the better of both counts.
        near = {one.name: one.near(best.values, self._problem.model) for one in open_ones if not one.fixed}.values()
        here = self.posterior(best)
        doubt = DOUBTED + DOUBTED_SHARE * max(0.0, best.chi2 - best.numbers) / 2
        promised: dict[tuple[str, ...], tuple[Prediction, Record]] = {}
        for one in predict(self._problem, best, self._measured, [*open_ones, *near]):
            record = self._worth(
                one.hypothesis, one.values, one.log_evidence, one.misfit, "forward selection", Outcome.PREDICTED
            )
            if record.names not in promised or record.log_posterior > promised[record.names][1].log_posterior:
                promised[record.names] = one, record
        ranked = sorted(promised.values(), key=lambda pair: -pair[1].log_posterior)
        found = []
        for number, (one, record) in enumerate(ranked):
            gain = record.log_posterior - here
            how = f"forward selection; its linear prediction gains {gain:.1f}"
            simulate = number < FITTED_EACH_ROUND and gain > -doubt
            found.append(Proposal(one, replace(record, proposed=how), simulate))
        return found

    def _smaller(self, best: Fit) -> list[Proposal["Prediction"]]:
        """Hypotheses without one of several candidates, but for those that were fitted before."""
        found = []
        known = {record.names for record in self.records if record.simulated}
        for name in best.names if len(best.names) > 1 else ():
            smaller = best.prior.hypothesis.without(name)
            if smaller.names in known:
                continue
            begin = replace(best.prior, hypothesis=smaller).begin()
            kept = {place for one in smaller.candidates for place in map(self._problem.model.place, one.values)}
            values = np.where([place in kept for place in range(len(begin))], best.values, begin)
            how = f"backward elimination of {name}"
            one = Prediction(smaller, values, best.log_evidence, best.misfit)
            record = self._worth(smaller, values, best.log_evidence, best.misfit, how, Outcome.PREDICTED)
            found.append(Proposal(one, record))
        return found

    def _fitted(self, hypothesis: Hypothesis, values: Floats) -> Fit:
        """The hypothesis fitted from values (P,), its windows where the measured motion begins, without disturbance."""
        near: Path = self._measured.path
        prior = replace(self._prior, hypothesis=hypothesis)
        return fit(self._problem, prior, values, replace(near, bins=self._problem.calm()))

    def _worth(
        self,
        hypothesis: Hypothesis,
        values: Floats,
        log_evidence: float,
        misfit: float,
        proposed: str,
        outcome: Outcome,
    ) -> Record:
        names = [name for candidate in hypothesis.candidates for name in candidate.values]
        set_to = {name: float(values[self._problem.model.place(name)]) for name in names}
        weight = log_prior(hypothesis, self._candidates)
        return Record(hypothesis.names, set_to, log_evidence, weight, misfit, proposed, outcome)


@dataclass(frozen=True)
class Prediction:
    """What the reduced quadratic about the measured motion promises of a hypothesis."""

    hypothesis: Hypothesis
    values: Floats  # (P,)
    log_evidence: float
    misfit: float


def predict(problem: Problem, best: Fit, measured: Linearised, candidates: Sequence[Candidate]) -> list[Prediction]:
    """Linear predictions of a hypothesis with each of the candidates beside what it has.

    A candidate is one response of the samples, that of its begin values, and a sensitivity there for each of its free
    parameters: along the measured motion both are worked out without simulating where the candidate would go.
    """
    base = best.prior
    own = parameter_columns(problem, base, measured)
    rows, width = [], own.shape[2]
    for candidate in candidates:
        at = best.values.copy()
        for name, value in candidate.values.items():
            at[problem.model.place(name)] = value
        rows.append(at)
        for place, size in _probes(problem, candidate):
            moved = at.copy()
            moved[place] += size
            rows.append(moved)
    columns = sensitivities(problem, measured, np.array(rows)) if rows else np.zeros((*own.shape[:2], 0))
    first = 0
    for candidate in candidates:  # from responses at begin values and beside them to sensitivities there
        for number, (place, size) in enumerate(_probes(problem, candidate), 1):
            width_of = problem.model.parameters[place].changed_width
            columns[..., first + number] = (columns[..., first + number] - columns[..., first]) * (width_of / size)
        first += 1 + len(_probes(problem, candidate))
    diverged = np.asarray(~np.isfinite(columns).all((0, 1)))
    columns[..., diverged] = 0.0
    precision = problem.precision(problem.disturbance.size)
    quadratic = reduced_quadratic(problem, measured, np.concatenate([own, columns], axis=2), precision)
    total = quadratic
    nothing = _promise(base, best.values, total.constant, total.b[:width], total.A[:width, :width])
    found, first = [], width
    for candidate in candidates:
        probes = _probes(problem, candidate)
        prior = replace(base, hypothesis=base.hypothesis.with_one(candidate))
        # Columns of the quadratic that play a part, and what of each a standard deviation of each parameter is.
        some = np.array([*range(width), *range(first, first + 1 + len(probes))])
        shares = np.zeros((len(some), len(prior.moving)))
        freed = {place: width + 1 + number for number, (place, _) in enumerate(probes)}
        for column, place in enumerate(prior.moving):
            if place in freed:
                shares[freed[place], column] = 1.0
            else:
                shares[np.flatnonzero(base.moving == place)[0], column] = prior.widths[place] / base.widths[place]
        A, there = total.A[np.ix_(some, some)], total.A[some, first]
        constant = float(total.constant - 2 * total.b[first] + total.A[first, first])
        pull = shares.T @ (total.b[some] - there)
        promise = _promise(prior, rows[first - width], constant, pull, shares.T @ A @ shares)
        far = diverged[first - width : first - width + 1 + len(probes)].any()
        evidence = -np.inf if far else best.log_evidence + promise[1] - nothing[1]
        found.append(Prediction(prior.hypothesis, promise[0], evidence, promise[2] / best.numbers))
        first += 1 + len(probes)
    return found


def _probes(problem: Problem, candidate: Candidate) -> list[tuple[int, float]]:
    """By free parameter of a candidate, its place and the step that shows what it does, away from the nearer bound."""
    found = []
    for name in candidate.free:
        place = problem.model.place(name)
        parameter, value = problem.model.parameters[place], candidate.values[name]
        up = parameter.high - value >= value - parameter.low
        found.append((place, PROBE * parameter.changed_width * (1.0 if up else -1.0)))
    return found


def _promise(prior: Prior, begin: Floats, constant: float, b: Floats, A: Floats) -> tuple[Floats, float, float]:
    """Values (P,), log evidence and chi-square at the minimum of a quadratic about ``begin`` (P,) within bounds."""
    at, away = prior.moving, prior.away(begin)
    low, high = ((bound - prior.center[at]) / prior.widths[at] - away for bound in prior.bounds)
    curvature = A + prior.precision
    step = least_quadratic(curvature, b - prior.precision @ away, np.minimum(low, 0.0), np.maximum(high, 0.0))
    values = begin.copy()
    values[at] += step * prior.widths[at]
    chi2 = float(constant - 2 * b @ step + step @ A @ step) + prior.cost(values)
    return values, prior.log_evidence(chi2, curvature), chi2


NOISE_MATTERS = 0.1  # relative change of the noise of a channel from which hypotheses are weighed again


def identify(
    model: Model,
    windows: Windows,
    disturbance: Disturbance,
    candidates: Sequence[Candidate],
    prior: Prior | None = None,
    known_noise: bool = False,
    progress: Callable[[str], None] = lambda step: None,
) -> Selection:
    """Find which candidates a log asks for.

    Noise is measured under the nominal model, and again under the best one: a model that is far off leaves some of its
    error in the noise. Where that changes the noise, the search goes on under the new one.

    Args:
        model: the simulator.
        windows: of the log.
        disturbance: force that may act on the sound system.
        candidates: changes to try.
        prior: of the nuisance parameters; by default independent, with their tolerances.
        known_noise: whether the noise of the windows stands.
        progress: called with each step in words.
    """
    progress("smoothing")
    problem = smooth(Problem.of(model, windows, disturbance), model.nominal, known_noise).problem
    selection = select(problem, candidates, prior, progress=progress)
    best = selection.best
    if not best.names:
        return selection
    progress("smoothing again")
    again = smooth(Problem.of(model, windows, disturbance, best.values), best.values, known_noise).problem
    before, after = problem.windows.noise.white, again.windows.noise.white
    if (abs(after / before - 1) > NOISE_MATTERS).any():
        return select(again, candidates, prior, best, progress)
    return selection
