"""One thruster that does what no known effect does, as a hypothesis: it has a map of its own, or changes by itself.

Whichever of the two has the higher evidence is told. The hypothesis is weighed against effects as these are against
each other; effects that stand in for such a thruster would blame others beside it.
"""

from dataclasses import dataclass, replace

import numpy as np

from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.identify.paths import WindowPath
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.search import Found
from auv_torchrl.diagnosis.localize.moments import Moments, changing_thruster
from auv_torchrl.diagnosis.localize.thrust_map import Mapped, measure_map
from auv_torchrl.diagnosis.thresholds import CLOSES
from auv_torchrl.diagnosis.verdict import Intermittence, ThrustMap
from auv_torchrl.sysid.trace import Outcome


@dataclass(frozen=True)
class Unlike:
    """A thruster that pushes otherwise than commanded, and what that is worth."""

    moments: Moments
    mapped: Mapped | None  # its map, where that has the higher evidence

    @property
    def thruster(self) -> int:
        """Its number, from 1."""
        return self.moments.thruster

    @property
    def evidence(self) -> float:
        """Log evidence of the log under this, and nothing else that is wrong."""
        return (self.mapped or self.moments).evidence

    @property
    def excess(self) -> float:
        """Chi-square per number under this."""
        return (self.mapped or self.moments).excess

    @property
    def intermittence(self) -> Intermittence | None:
        """Where it gives all of its thrust or nothing, from moment to moment."""
        return None if self.mapped else self.moments.intermittence()

    @property
    def thrust_map(self) -> ThrustMap | None:
        """Where it gives the same at one command."""
        return self.mapped and self.mapped.measured

    @property
    def explains(self) -> bool:
        """Whether it leaves too little for any effect beside it."""
        return self.excess - 1 < CLOSES * (self.moments.before - 1)


def unlike_thruster(problem: Problem, path: WindowPath) -> Unlike | None:
    """The thruster that pushes otherwise than commanded, where one stands out from all others; else None."""
    moments = changing_thruster(problem, path)
    if moments is None:
        return None
    mapped = measure_map(problem, path, moments.thruster)
    return Unlike(moments, mapped if mapped is not None and mapped.evidence > moments.evidence else None)


def evidence_of_unlike(problem: Problem, path: WindowPath) -> float:
    """Log evidence of such a thruster, where that leaves too little for any effect beside it."""
    unlike = unlike_thruster(problem, path)
    return unlike.evidence if unlike is not None and unlike.explains else -np.inf


def unless_unlike(found: Found) -> Found | None:
    """Without effects, where such a thruster is likelier than all of them; None where it is not."""
    if not found.best.explanation.effects or _likelier(found) is None:
        return None
    return replace(found, best=found.none, trace=found.trace.instead((), Outcome.CHANGING))


def is_unlike(found: Found, settings: Settings) -> bool:
    """Whether such a thruster leaves nothing of a log, and is likelier than all effects."""
    unlike = _likelier(found)
    return unlike is not None and unlike.excess < settings.excess


def _likelier(found: Found) -> Unlike | None:
    """Such a thruster, where it closes as much more of what effects leave as one more effect had to."""
    unlike, best = unlike_thruster(found.problem, found.follow), found.best
    worth = best.evidence + CLOSES * max(0.0, best.chi2 - best.quadratic.numbers) / 2
    return unlike if unlike is not None and unlike.evidence > worth else None
