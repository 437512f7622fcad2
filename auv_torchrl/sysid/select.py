"""Which changes of a model a log asks for: forward selection, backward elimination, and the trace of both."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from auv_torchrl.sysid.fit import PROBE, Fit, fit, least_quadratic, parameter_columns
from auv_torchrl.sysid.linear import Linearised, reduced_quadratic, sensitivities
from auv_torchrl.sysid.model import Floats
from auv_torchrl.sysid.path import Path, Problem
from auv_torchrl.sysid.prior import Candidate, Hypothesis, Prior, log_prior
from auv_torchrl.sysid.smooth import follow

FITTED_EACH_ROUND = 4  # candidates that are simulated in a round of forward selection, the best by linear prediction
DOUBTED = 1.0  # log units by which the linear prediction of a small change may be too low,
DOUBTED_SHARE = 0.1  # and share of the log likelihood that is missing: where much is left, slopes hold less far
MOST_AT_ONCE = 6  # candidates of a hypothesis: more than that is a file that is wrong, not faults


class Outcome(Enum):
    """What became of a hypothesis; the value is the phrase that a person reads."""

    KEPT = "kept: no other hypothesis has a higher posterior"
    STEP = "kept on the way: a later one has more"
    NO_GAIN = "dropped: the log does not pay for what it adds"
    BEATEN = "dropped: another candidate of the same round has more"
    ELIMINATED = "tried without this candidate, and put back: the log pays for it"
    LEANER = "kept on the way: the log does not pay for what was taken away"
    PREDICTED = "not simulated: the linear prediction promises too little"


@dataclass(frozen=True)
class Record:
    """A hypothesis that was looked at."""

    names: tuple[str, ...]
    values: dict[str, float]  # of the parameters that its candidates set
    log_evidence: float  # of the fit, or of the linear prediction where nothing was simulated
    log_prior: float
    misfit: float  # reduced chi-square
    proposed: str  # by what
    outcome: Outcome

    @property
    def log_posterior(self) -> float:
        """Log posterior probability, up to what all hypotheses share."""
        return self.log_evidence + self.log_prior

    @property
    def simulated(self) -> bool:
        """Whether the hypothesis was fitted by full simulation."""
        return self.outcome is not Outcome.PREDICTED


@dataclass(frozen=True)
class SearchTrace:
    """Every hypothesis that was looked at, in order."""

    records: tuple[Record, ...]

    @property
    def best(self) -> Record:
        """The hypothesis that was kept."""
        return next(record for record in self.records if record.outcome is Outcome.KEPT)

    @property
    def runner_up(self) -> Record | None:
        """The simulated hypothesis with the next highest posterior; None where there is no other."""
        others = [record for record in self.records if record.simulated and record.names != self.best.names]
        return max(others, key=lambda record: record.log_posterior, default=None)

    def why(self, name: str) -> str:
        """Why a candidate is part of the best hypothesis, or is not.

        Raises:
            KeyError: for a name that no hypothesis has.
        """
        having = [record for record in self.records if name in record.names]
        if not having:
            raise KeyError(f"no candidate {name!r} was looked at")
        best = self.best
        if name in best.names:
            without = [record for record in self.records if record.simulated and name not in record.names]
            other = max(without, key=lambda record: record.log_posterior)
            gain = best.log_posterior - other.log_posterior
            return f"{name}: kept; the best hypothesis without it ({_called(other)}) is {gain:.1f} log units behind"
        nearest = max(having, key=lambda record: record.log_posterior)
        behind = best.log_posterior - nearest.log_posterior
        how = "simulated" if nearest.simulated else "predicted linearly"
        return f"{name}: {_called(nearest)}, {how}, is {behind:.1f} log units behind; {nearest.outcome.value}"

    def table(self) -> list[str]:
        """Lines for people: the simulated hypotheses, in order."""
        lines = [f"{'hypothesis':<36} {'log evidence':>12} {'misfit':>7}  outcome"]
        for record in self.records:
            if record.simulated:
                what = _called(record)
                lines.append(f"{what:<36} {record.log_evidence:>12.1f} {record.misfit:>7.2f}  {record.outcome.value}")
        return lines


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


class _Search:
    """A search on its way: it gathers records and fits."""

    def __init__(
        self, problem: Problem, candidates: tuple[Candidate, ...], prior: Prior, progress: Callable[[str], None]
    ):
        self._problem, self._candidates, self._prior, self._progress = problem, candidates, prior, progress
        self._records: list[Record] = []
        self._fits: list[Fit] = []

    def run(self, begin: Fit | None) -> Selection:
        """From nothing, or from a hypothesis, to the best one."""
        measured = follow(self._problem, self._prior.center)
        best = self._fit(Hypothesis(), self._prior.center, measured.path)
        self._note(best, "the beginning", Outcome.STEP)
        if begin is not None and begin.names:
            measured = follow(self._problem, begin.values)
            again = self._fit(begin.prior.hypothesis, begin.values, measured.path)
            self._note(again, "the search under other noise", Outcome.STEP)
            best = self._backward(max(best, again, key=self._posterior))
        while len(best.names) < MOST_AT_ONCE:
            larger = self._forward(best, measured)
            if larger is None:
                break
            best = self._backward(larger)
            measured = follow(self._problem, best.values, measured.path)
        kept = [
            replace(record, outcome=Outcome.KEPT)
            if record.simulated and record.names == best.names and record.log_evidence == best.log_evidence
            else record
            for record in self._records
        ]
        return Selection(self._problem, best, tuple(self._fits), SearchTrace(tuple(kept)))

    def _forward(self, best: Fit, measured: Linearised) -> Fit | None:
        """The best of the hypotheses with one more candidate; None where none has a higher posterior."""
        hypothesis = best.prior.hypothesis
        open_ones = [candidate for candidate in self._candidates if not hypothesis.overlaps(candidate)]
        # Slopes at far values say little about small changes, and the other way round: the better of both counts.
        near = {one.name: one.near(best.values, self._problem.model) for one in open_ones if not one.fixed}.values()
        promised = self._best_of_each(predict(self._problem, best, measured, [*open_ones, *near]))
        here = self._total(hypothesis, best.log_evidence)
        doubt = DOUBTED + DOUBTED_SHARE * max(0.0, best.chi2 - best.numbers) / 2
        tried: list[tuple[Fit, str]] = []
        left: list[tuple[Prediction, str]] = []
        for number, one in enumerate(promised):
            gain = self._total(one.hypothesis, one.log_evidence) - here
            how = f"forward selection; its linear prediction gains {gain:.1f}"
            if number < FITTED_EACH_ROUND and gain > -doubt:
                self._progress(f"trying {' + '.join(one.hypothesis.names)}")
                tried.append((self._fit(one.hypothesis, one.values, measured.path), how))
            else:
                left.append((one, how))
        # Linear predictions of one round are compared with each other: all share what is wrong with their quadratic.
        kept = max((found.log_evidence for found, _ in tried), default=best.log_evidence)
        too_high = max((p.log_evidence for p in promised[: len(tried)]), default=best.log_evidence) - kept
        self._records += [self._predicted(one, max(0.0, too_high), how) for one, how in left]
        if not tried:
            return None
        winner = max((found for found, _ in tried), key=self._posterior)
        better = self._posterior(winner) > self._posterior(best)
        for found, how in tried:
            beaten = Outcome.BEATEN if better else Outcome.NO_GAIN
            self._note(found, how, Outcome.STEP if better and found is winner else beaten)
        return winner if better else None

    def _best_of_each(self, promised: list["Prediction"]) -> list["Prediction"]:
        """By hypothesis the prediction with the highest posterior, the highest first."""
        best: dict[tuple[str, ...], Prediction] = {}
        for one in sorted(promised, key=lambda one: -self._total(one.hypothesis, one.log_evidence)):
            best.setdefault(one.hypothesis.names, one)
        return list(best.values())

    def _backward(self, best: Fit) -> Fit:
        """The hypothesis without the candidates that the log does not pay for."""
        for name in best.names if len(best.names) > 1 else ():
            smaller = best.prior.hypothesis.without(name)
            if any(record.simulated and record.names == smaller.names for record in self._records):
                continue  # its posterior is known, and the search went on from there
            self._progress(f"trying without {name}")
            begin = replace(best.prior, hypothesis=smaller).begin()
            kept = {place for one in smaller.candidates for place in map(self._problem.model.place, one.values)}
            begin = np.where([place in kept for place in range(len(begin))], best.values, begin)
            found = self._fit(smaller, begin, best.linear.path)
            pays = self._posterior(best) > self._posterior(found)
            self._note(found, f"backward elimination of {name}", Outcome.ELIMINATED if pays else Outcome.LEANER)
            if not pays:
                return self._backward(found)
        return best

    def _fit(self, hypothesis: Hypothesis, values: Floats, near: Path) -> Fit:
        """The hypothesis fitted from values (P,), its windows where the measured motion begins, without disturbance."""
        found = fit(
            self._problem, replace(self._prior, hypothesis=hypothesis), values, replace(near, bins=self._problem.calm())
        )
        self._fits.append(found)
        return found

    def _total(self, hypothesis: Hypothesis, log_evidence: float) -> float:
        return log_evidence + log_prior(hypothesis, self._candidates)

    def _posterior(self, found: Fit) -> float:
        return self._total(found.prior.hypothesis, found.log_evidence)

    def _note(self, found: Fit, proposed: str, outcome: Outcome) -> None:
        names = [name for candidate in found.prior.hypothesis.candidates for name in candidate.values]
        values = {name: float(found.values[self._problem.model.place(name)]) for name in names}
        weight = log_prior(found.prior.hypothesis, self._candidates)
        record = Record(found.names, values, found.log_evidence, weight, found.misfit, proposed, outcome)
        self._records.append(record)

    def _predicted(self, one: "Prediction", too_high: float, proposed: str) -> Record:
        names = [name for candidate in one.hypothesis.candidates for name in candidate.values]
        values = {name: float(one.values[self._problem.model.place(name)]) for name in names}
        weight = log_prior(one.hypothesis, self._candidates)
        evidence = one.log_evidence - too_high
        return Record(one.hypothesis.names, values, evidence, weight, one.misfit, proposed, Outcome.PREDICTED)


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


def _called(record: Record) -> str:
    return " + ".join(record.names) or "nothing"
