"""What is known of parameters before a log, and how likely each hypothesis is then.

A hypothesis is a set of candidates. In each of them the nuisance parameters have the narrow prior of their tolerance,
the parameters that a candidate frees the wide prior of a changed value, and all others stand at their nominal value. So
"nothing is wrong" and "the gain is another" differ in one standard deviation, and are fitted in the same way.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import lgamma, log

import numpy as np

from auv_torchrl.sysid.model import Floats, Model

NOTHING = 0.5  # prior probability that nothing is wrong: a log that shows nothing must not be explained
ONE_MORE = 0.1  # prior odds that one more thing is wrong beside what is: faults come alone as a rule


@dataclass(frozen=True)
class Candidate:
    """A change of the model that a hypothesis may hold, with the values from which its fit begins.

    Candidates of one name are the same change begun from other values, as a delay is that begins at 0.1 or 0.3 s.
    """

    name: str
    values: Mapping[str, float]  # by parameter
    fixed: tuple[str, ...] = ()  # parameters that stay at these values: choices, as of a plug
    odds: float = 1.0  # prior odds against the other candidates

    @cached_property
    def free(self) -> tuple[str, ...]:
        """Parameters that are fitted."""
        return tuple(name for name in self.values if name not in self.fixed)

    def near(self, values: Floats, model: Model) -> "Candidate":
        """The same change begun from where its parameters stand in ``values`` (P,)."""
        return replace(self, values={name: float(values[model.place(name)]) for name in self.values})


@dataclass(frozen=True)
class Hypothesis:
    """A set of candidates of different names."""

    candidates: tuple[Candidate, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the candidates, sorted: what the hypothesis is called."""
        return tuple(sorted(candidate.name for candidate in self.candidates))

    def with_one(self, candidate: Candidate) -> "Hypothesis":
        """The hypothesis with one more candidate."""
        return Hypothesis((*self.candidates, candidate))

    def without(self, name: str) -> "Hypothesis":
        """The hypothesis without a candidate."""
        return Hypothesis(tuple(candidate for candidate in self.candidates if candidate.name != name))

    def overlaps(self, candidate: Candidate) -> bool:
        """Whether a candidate is in the hypothesis, or sets a parameter that one there sets."""
        taken = {name for one in self.candidates for name in one.values}
        return candidate.name in self.names or bool(taken & set(candidate.values))


@dataclass(frozen=True)
class Prior:
    """Gaussian prior of the parameters under a hypothesis.

    ``covariance`` couples nuisance parameters, where healthy flights have shown how they go together; by default they
    are independent, each with its tolerance.
    """

    model: Model
    hypothesis: Hypothesis
    mean: Floats | None = None  # (P,) of the nuisance parameters; None: nominal values
    covariance: Floats | None = field(default=None, repr=False)  # (P, P); None: of the tolerances

    @cached_property
    def freed(self) -> np.ndarray:
        """(P,) True for parameters that a candidate frees."""
        names = {name for candidate in self.hypothesis.candidates for name in candidate.free}
        return np.array([parameter.name in names for parameter in self.model.parameters])

    @cached_property
    def fixed(self) -> np.ndarray:
        """(P,) True for parameters that a candidate sets and no fit moves."""
        names = {name for candidate in self.hypothesis.candidates for name in candidate.fixed}
        return np.array([parameter.name in names for parameter in self.model.parameters])

    @cached_property
    def widths(self) -> Floats:
        """(P,) standard deviations; 0 where a parameter stands."""
        known = np.array([parameter.tolerance for parameter in self.model.parameters])
        if self.covariance is not None:
            known = np.sqrt(np.diag(self.covariance))
        changed = np.array([parameter.changed_width for parameter in self.model.parameters])
        return np.where(self.fixed, 0.0, np.where(self.freed, changed, known))

    @cached_property
    def moving(self) -> np.ndarray:
        """Places (k,) of the parameters that are fitted."""
        return np.flatnonzero(self.widths > 0)

    @cached_property
    def precision(self) -> Floats:
        """Inverse covariance (k, k) of those, in units of their standard deviations."""
        at = self.moving
        if self.covariance is None:
            return np.eye(len(at))
        together = self.covariance[np.ix_(at, at)] / np.outer(self.widths[at], self.widths[at])
        alone = self.freed[at]
        together[alone, :], together[:, alone] = 0.0, 0.0
        together[alone, alone] = 1.0
        return np.linalg.inv(together)

    @cached_property
    def center(self) -> Floats:
        """(P,) expected values, where candidates fix parameters at theirs."""
        center = self.model.nominal if self.mean is None else np.where(self.freed, self.model.nominal, self.mean)
        for candidate in self.hypothesis.candidates:
            for name in candidate.fixed:
                center[self.model.place(name)] = candidate.values[name]
        return center

    def begin(self) -> Floats:
        """(P,) values from which a fit begins: the center, and the candidates' own."""
        values = self.center.copy()
        for candidate in self.hypothesis.candidates:
            for name, value in candidate.values.items():
                values[self.model.place(name)] = value
        return values

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Least and greatest (k,) values of the parameters that are fitted."""
        parameters = [self.model.parameters[place] for place in self.moving]
        return np.array([p.low for p in parameters]), np.array([p.high for p in parameters])

    def away(self, values: Floats) -> Floats:
        """(k,) deviations of values (P,) from what is expected, in standard deviations."""
        at = self.moving
        return (values[at] - self.center[at]) / self.widths[at]

    def cost(self, values: Floats) -> float:
        """Chi-square of values (P,) against the prior."""
        away = self.away(values)
        return float(away @ self.precision @ away)

    def log_evidence(self, chi2: float, curvature: Floats) -> float:
        """Laplace's approximation at a minimum.

        Args:
            chi2: there, the cost of the prior included.
            curvature: (k, k) of half of it in units of the standard deviations, that of the prior included.
        """
        return -0.5 * chi2 + 0.5 * float(np.linalg.slogdet(self.precision)[1] - np.linalg.slogdet(curvature)[1])


def log_prior(hypothesis: Hypothesis, candidates: Sequence[Candidate]) -> float:
    """Log prior probability of a hypothesis among all that can be made of ``candidates``.

    Half is that nothing is wrong. The rest goes to sets by their size, each further candidate a tenth as likely, and is
    shared among sets of one size by the odds of their candidates.
    """
    if not hypothesis.candidates:
        return log(NOTHING)
    odds = {candidate.name: candidate.odds for candidate in candidates}
    mean, size = sum(odds.values()) / len(odds), len(hypothesis.candidates)
    sets = lgamma(len(odds) + 1) - lgamma(size + 1) - lgamma(len(odds) - size + 1)
    share = sum(log(odds[name] / mean) for name in hypothesis.names)
    return log(1 - NOTHING) + log(1 - ONE_MORE) + (size - 1) * log(ONE_MORE) + share - sets
