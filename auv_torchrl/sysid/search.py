"""The search for the best hypothesis: from one to its best neighbour, until no neighbour is better.

A neighbour has one change more (forward selection), one less (backward elimination), or another change in place of one.
Whoever searches says which neighbours there are, and fits them; this module compares them and keeps the trace.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Generic, TypeVar

from auv_torchrl.sysid.trace import Outcome, Record, SearchTrace

ROUNDS = 40  # comparisons with neighbours at most; six are usual

What = TypeVar("What")  # a hypothesis that may be fitted
Fitted = TypeVar("Fitted")


class Way(Enum):
    """How a neighbour differs; the value is what becomes of one that is not better."""

    LARGER = Outcome.NO_GAIN
    SMALLER = Outcome.NEEDED
    EXCHANGED = Outcome.BEATEN


@dataclass(frozen=True)
class Proposal(Generic[What]):
    """A neighbour, and why it may be worth a simulation."""

    what: What
    promised: Record  # the same by linear prediction
    simulate: bool = True  # whether it promises enough


class Search(ABC, Generic[What, Fitted]):
    """A search on its way: it gathers records and fits."""

    ways: Sequence[Way] = (Way.LARGER, Way.SMALLER)

    def __init__(self) -> None:
        self.records: list[Record] = []
        self.fits: list[Fitted] = []
        self._rows: list[int] = []  # of the record of each fit

    @abstractmethod
    def neighbours(self, way: Way, best: Fitted) -> Sequence[Proposal[What]]:
        """Neighbours of a hypothesis, the most promising first."""

    @abstractmethod
    def fit(self, proposal: Proposal[What], best: Fitted) -> Fitted:
        """A neighbour of ``best`` fitted by full simulation."""

    @abstractmethod
    def record(self, fitted: Fitted, proposed: str, outcome: Outcome) -> Record:
        """What a fit is worth."""

    def settled(self, best: Fitted) -> Fitted:
        """A fit that is the best so far, fitted to the end."""
        return best

    def is_small(self, fitted: Fitted) -> bool:
        """Whether a change of a fit does less than a sound system may do: such a fit is never the best."""
        return False

    def climb(self, best: Fitted) -> Fitted:
        """From one hypothesis to the best that is reached by better and better neighbours.

        A way that led on is taken again, then the next; the search ends where all of them lead nowhere.
        """
        in_vain, turn = 0, 0
        for _ in range(ROUNDS):
            better = self.better(self.ways[turn], best)
            if better is not None:
                best, in_vain = self.settle(better), 0
                continue
            in_vain, turn = in_vain + 1, (turn + 1) % len(self.ways)
            if in_vain == len(self.ways):
                break
        return best

    def note(self, fitted: Fitted, proposed: str, outcome: Outcome = Outcome.STEP) -> Fitted:
        """Keep a fit and its record."""
        self.fits.append(fitted)
        self._rows.append(len(self.records))
        self.records.append(self.record(fitted, proposed, outcome))
        return fitted

    def posterior(self, fitted: Fitted) -> float:
        """Log posterior probability of a fit, up to what all share."""
        return self.record(fitted, "", Outcome.STEP).log_posterior

    def trace(self, best: Fitted) -> SearchTrace:
        """All records, that of the best marked as kept."""
        row = self._rows[self._place(best)]
        kept = replace(self.records[row], outcome=Outcome.KEPT)
        return SearchTrace((*self.records[:row], kept, *self.records[row + 1 :]))

    def better(self, way: Way, best: Fitted) -> Fitted | None:
        """The best neighbour of one way; None where none has a higher posterior."""
        proposals = self.neighbours(way, best)
        fitted = [(self.fit(one, best), one) for one in proposals if one.simulate]
        too_high = 0.0
        if fitted:
            # Linear predictions of one round are compared: all share what is wrong with their quadratic.
            promised = max(proposal.promised.log_evidence for _, proposal in fitted)
            too_high = max(0.0, promised - max(self.record(one, "", Outcome.STEP).log_evidence for one, _ in fitted))
        predicted = [one.promised for one in proposals if not one.simulate]
        self.records += [replace(one, log_evidence=one.log_evidence - too_high) for one in predicted]
        if not fitted:
            return None
        small = {id(one) for one, _ in fitted if self.posterior(one) > self.posterior(best) and self.is_small(one)}
        winner = max((one for one, _ in fitted if id(one) not in small), key=self.posterior, default=best)
        is_better = self.posterior(winner) > self.posterior(best)
        for one, proposal in fitted:
            if id(one) in small:
                outcome = Outcome.SMALL
            elif is_better and one is winner:
                outcome = Outcome.FEWER if way is Way.SMALLER else Outcome.STEP
            else:
                outcome = Outcome.BEATEN if is_better else way.value
            self.note(one, proposal.promised.proposed, outcome)
        return winner if is_better else None

    def settle(self, best: Fitted) -> Fitted:
        """The best so far fitted to the end, in place of what it was."""
        settled = self.settled(best)
        if settled is not best:
            self.exchange(best, settled)
        return settled

    def exchange(self, old: Fitted, new: Fitted, outcome: Outcome | None = None) -> None:
        """Keep a better fit of the same hypothesis in place of one that was noted, and say what became of it."""
        place = self._place(old)
        before = self.records[self._rows[place]]
        self.fits[place] = new
        self.records[self._rows[place]] = self.record(new, before.proposed, outcome or before.outcome)

    @property
    def counted(self) -> list[Fitted]:
        """The fits that were not dropped as small."""
        rows = zip(self.fits, self._rows, strict=True)
        return [one for one, row in rows if self.records[row].outcome is not Outcome.SMALL]

    def _place(self, fitted: Fitted) -> int:
        """Where a fit stands among all; fits hold arrays, which do not compare."""
        return next(place for place, one in enumerate(self.fits) if one is fitted)
