"""What a search leaves behind."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from auv_torchrl.diagnosis.identify.fit import reassess
from auv_torchrl.diagnosis.identify.paths import Fit, WindowPath
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.screen import Field
from auv_torchrl.diagnosis.thresholds import FAULT_KNOWN
from auv_torchrl.sysid.trace import SearchTrace


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
