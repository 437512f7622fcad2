"""The trace of a search: every hypothesis that was tried, what it is worth, and what became of it."""

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np


class Outcome(Enum):
    """What became of a hypothesis; the value is the phrase that a person reads."""

    KEPT = "kept: no hypothesis that counts has a higher posterior"
    LEFT = "kept: held-out flight took back what fits better"
    STEP = "kept on the way: a later one has more"
    NO_GAIN = "dropped: the log does not pay for what it adds"
    SMALL = "dropped: it does less than what is uncertain about a sound system anyway"
    BEATEN = "dropped: another hypothesis of the same round has more"
    NEEDED = "tried without this, and put back: the log pays for it"
    FEWER = "kept on the way: the log does not pay for what was taken away"
    REFUTED = "taken back: held-out flight is predicted no worse without it"
    CHANGING = "dropped: a part that gives now more and now less explains the log better"
    OUTDONE = "not simulated: a part that gives now more and now less explains the log better"
    PREDICTED = "not simulated: the linear prediction promises too little"

    @property
    def is_kept(self) -> bool:
        """Whether the hypothesis is the one that stands at the end."""
        return self in (Outcome.KEPT, Outcome.LEFT)


OUT = frozenset((Outcome.REFUTED, Outcome.CHANGING, Outcome.OUTDONE))  # what has no share in the probabilities


@dataclass(frozen=True)
class Record:
    """A hypothesis that was tried."""

    names: tuple[str, ...]  # of the changes in it
    values: dict[str, float]  # of the parameters that they set
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
        return self.outcome not in (Outcome.PREDICTED, Outcome.OUTDONE)

    @property
    def called(self) -> str:
        """The names, or "nothing"."""
        return " + ".join(self.names) or "nothing"


@dataclass(frozen=True)
class SearchTrace:
    """Every hypothesis that was tried, in order."""

    records: tuple[Record, ...]

    @property
    def best(self) -> Record:
        """The hypothesis that was kept."""
        return next(record for record in self.records if record.outcome.is_kept)

    @property
    def best_fit(self) -> Record:
        """The hypothesis that is behind none: the best one, or what held-out flight took back."""
        if self.best.outcome is Outcome.KEPT:
            return self.best
        return max((record for record in self.records if record.simulated), key=lambda record: record.log_posterior)

    @property
    def runner_up(self) -> Record | None:
        """The simulated hypothesis with the next highest posterior that counts; None where there is no other."""
        counted = [record for record in self.records if record.simulated and record.outcome is not Outcome.SMALL]
        others = [record for record in counted if record.names != self.best.names]
        return max(others, key=lambda record: record.log_posterior, default=None)

    @property
    def best_of_each(self) -> dict[tuple[str, ...], float]:
        """The highest log posterior by hypothesis; one that was tried from several values counts once.

        A hypothesis that held-out flight refuted does not count, nor one that a part that changes explains better.
        """
        best: dict[tuple[str, ...], float] = {}
        for record in self.records:
            if np.isfinite(record.log_posterior) and record.outcome not in OUT:
                best[record.names] = max(record.log_posterior, best.get(record.names, -np.inf))
        return best

    def instead(self, names: tuple[str, ...], outcome: Outcome) -> "SearchTrace":
        """The trace with another simulated hypothesis as the best one, and ``outcome`` for the one that was.

        Raises:
            KeyError: for a hypothesis that was not simulated.
        """
        others = [record for record in self.records if record.simulated and record.names == names]
        if not others:
            raise KeyError(f"no hypothesis of {' + '.join(names) or 'nothing'} was simulated")
        best, now = self.best, max(others, key=lambda record: record.log_posterior)
        kept = Outcome.LEFT if outcome is Outcome.REFUTED else Outcome.KEPT
        changed = {id(best): outcome, id(now): kept}
        records = (replace(one, outcome=changed[id(one)]) if id(one) in changed else one for one in self.records)
        return SearchTrace(tuple(records))

    def weighed_again(self, whole: "SearchTrace") -> "SearchTrace":
        """The trace with hypotheses as far behind the best one as they are in ``whole``, which fitted them to more."""
        fitted: dict[tuple[str, ...], float] = {}
        for record in whole.records:
            if record.simulated and np.isfinite(record.log_evidence):
                fitted[record.names] = max(record.log_evidence, fitted.get(record.names, -np.inf))
        best, top = whole.best, self.best.log_evidence
        behind = {names: evidence - best.log_evidence for names, evidence in fitted.items()}
        records = (
            replace(one, log_evidence=top + behind[one.names]) if one.simulated and one.names in behind else one
            for one in self.records
        )
        return SearchTrace(tuple(records))

    def why(self, name: str) -> str:
        """Why a change is part of the best hypothesis, or is not.

        Raises:
            KeyError: for a name that no hypothesis has.
        """
        having = [record for record in self.records if name in record.names]
        if not having:
            raise KeyError(f"no change {name!r} was tried")
        best = self.best
        if name in best.names:
            counted = [record for record in self.records if record.simulated and record.outcome not in OUT]
            without = [record for record in counted if name not in record.names]
            other = max(without, key=lambda record: record.log_posterior)
            gain = best.log_posterior - other.log_posterior
            return f"kept; without it the best hypothesis, {other.called}, is {gain:.1f} log units behind"
        nearest = max(having, key=lambda record: record.log_posterior)
        fits = self.best_fit
        behind = fits.log_posterior - nearest.log_posterior
        beside = [other for other in (fits if name in fits.names else nearest).names if other != name]
        where = f"beside {' + '.join(beside)}" if beside else "alone"
        if name in fits.names:
            return f"{where} it fits best; {Outcome.REFUTED.value}"
        if not np.isfinite(behind):
            return f"{where} its simulation diverges"
        if nearest.outcome in (Outcome.SMALL, Outcome.CHANGING, Outcome.OUTDONE):
            return f"{where} it was {nearest.outcome.value}"
        how = "simulated" if nearest.simulated else "by linear prediction"
        return f"{where} it is {abs(behind):.1f} log units {'behind' if behind >= 0 else 'ahead'}, {how}"

    def table(self) -> list[str]:
        """Lines for people: the simulated hypotheses, in order."""
        lines = [f"{'hypothesis':<36} {'log evidence':>12} {'misfit':>7}  outcome"]
        return lines + [
            f"{record.called:<36} {record.log_evidence:>12.1f} {record.misfit:>7.2f}  {record.outcome.value}"
            for record in self.records
            if record.simulated
        ]
