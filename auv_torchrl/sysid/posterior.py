"""How probable each change is, how well its values are known, and what the log cannot tell apart."""

from dataclasses import dataclass

import numpy as np

from auv_torchrl.sysid.fit import Fit
from auv_torchrl.sysid.model import Parameter
from auv_torchrl.sysid.trace import SearchTrace

Z95 = 1.96  # standard deviations: half of an interval that holds 95 % of a normal distribution
NEAR = 3.0  # log units between hypotheses that a log does not tell apart: odds of 20 to 1


@dataclass(frozen=True)
class Interval:
    """A value with its 95 % credible interval."""

    parameter: Parameter
    value: float
    low: float
    high: float

    @property
    def at_bound(self) -> bool:
        """Whether the value stands at a bound of its parameter: then the bound says it, not the log."""
        edge = 1e-6 * (self.parameter.high - self.parameter.low)
        return min(self.value - self.parameter.low, self.parameter.high - self.value) <= edge

    @property
    def is_determined(self) -> bool:
        """Whether the log determines the value: its interval is narrower than half of the prior's."""
        return self.high - self.low < Z95 * self.parameter.changed_width

    def __str__(self) -> str:
        unit = "" if self.parameter.unit == "1" else f" {self.parameter.unit}"
        return f"{self.parameter.name} {self.value:.3g} ({self.low:.3g} to {self.high:.3g}){unit}"


def weights(trace: SearchTrace, tempering: float = 1.0) -> dict[tuple[str, ...], float]:
    """Posterior probability of each hypothesis that was tried; they add up to 1.

    Hypotheses that were not simulated count by their linear prediction. A hypothesis that was tried from several
    values counts once, by the best. ``tempering`` is of the log posterior; 1 where noise and model are exact.
    """
    best = trace.best_of_each
    log = tempering * np.array(list(best.values()))
    share = np.exp(log - log.max())
    return dict(zip(best, (share / share.sum()).tolist(), strict=True))


def probabilities(trace: SearchTrace, tempering: float = 1.0, nothing: str | None = None) -> dict[str, float]:
    """Posterior probability of each candidate that was tried: the sum over the hypotheses that hold it.

    Args:
        trace: of a search.
        tempering: see :func:`weights`.
        nothing: what the hypothesis without a candidate is called; without a name it is left out.

    """
    found = {name: 0.0 for record in trace.records for name in record.names}
    for names, share in weights(trace, tempering).items():
        for name in names or ((nothing,) if nothing else ()):
            found[name] = found.get(name, 0.0) + share
    # Shares that add up to 1 may add up to 1 and a rounding error.
    return dict(sorted(((name, min(p, 1.0)) for name, p in found.items()), key=lambda item: -item[1]))


def intervals(fit: Fit) -> list[Interval]:
    """The values that the candidates of a fit free, with their intervals.

    Where the model leaves more than the noise, errors of values are as much larger than the noise says.
    """
    spread = np.sqrt(np.diag(fit.covariance) * max(1.0, fit.misfit))
    found = []
    for place in np.flatnonzero(fit.prior.freed):
        parameter, value, half = fit.prior.model.parameters[place], float(fit.values[place]), Z95 * spread[place]
        low, high = max(parameter.low, value - half), min(parameter.high, value + half)
        found.append(Interval(parameter, value, float(low), float(high)))
    return found


def indistinguishable(trace: SearchTrace) -> list[tuple[str, ...]]:
    """Hypotheses that are nearly as probable as the best, most probable first, the best among them."""
    simulated = SearchTrace(tuple(record for record in trace.records if record.simulated))
    best = simulated.best_of_each
    top = max(best.values())
    near = [names for names, value in best.items() if top - value < NEAR]
    return sorted(near, key=lambda names: -best[names])


def chance(fit: Fit) -> float:
    """Probability that noise and disturbance alone leave as much as a fit does."""
    from scipy.special import chdtrc  # here: it takes long to import

    return float(chdtrc(fit.numbers, fit.chi2))


def is_explained(fit: Fit, tolerated: float = 1.1) -> bool:
    """Whether a fit leaves no more than chance, or than ``tolerated`` as reduced chi-square.

    The tolerance is what the physics of the model may be wrong by; with enough samples every model is wrong.
    """
    return fit.misfit < tolerated or chance(fit) > 0.01
