"""What is worth simulating: the effects, or sets of effects, that promise most along the measured motion."""

from collections.abc import Sequence
from enum import Enum

import numpy as np

from auv_torchrl.diagnosis.identify.judged import Base, Judged
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.screen import Field, Screened
from auv_torchrl.diagnosis.identify.sketches import is_near, sketch_explanations
from auv_torchrl.diagnosis.thresholds import EVIDENCE_SLIP, POLISHED, TURNED_ROUND, WITHIN, WORTH_AN_EFFECT


class Others(Enum):
    """What a search may simulate besides its hints."""

    NONE = "none"
    SINGLE = "single"
    ALL = "all"


def candidates_of(
    problem: Problem, follow: Base, field: Field, families: list[Screened], others: Others
) -> tuple[Sequence[Screened | Judged], float]:
    """What to simulate, and the chi-square per number that the best of it promises to leave.

    They are single effects, or where none comes near, and other ones are asked for, what a look along the measured
    motion shows.
    """
    if not families:  # no effect leaves a mark, or all are ignored
        return [], np.inf
    numbers = field.quadratic.numbers
    if others is Others.SINGLE or is_near(families[0].chi2, numbers):
        return _promising(field, families), families[0].chi2 / numbers
    sketches = sketch_explanations(problem, follow, field, families)
    as_good = [sketch for sketch in sketches if sketch.chi2 < TURNED_ROUND * sketches[0].chi2]
    return _promising(field, as_good), sketches[0].chi2 / numbers


def _promising(field: Field, ranked: Sequence[Screened | Judged]) -> list[Screened | Judged]:
    """The few that may turn out best once simulated, best first."""
    none = field.none().evidence
    least = ranked[0].evidence - EVIDENCE_SLIP - WITHIN * max(0.0, ranked[0].evidence - none)
    if field.problem.layout.moves_unseen:  # a large tilt that nobody measured is far from where the marks were taken
        least = -np.inf
    kept, seen = [], set()
    for screened in ranked:
        key = frozenset(screened.explanation.effects)
        dominated = any(known < key for known in seen)  # the extra effect is added later if it pays
        if screened.evidence > max(least, none - EVIDENCE_SLIP / 4) and key not in seen and not dominated:
            kept.append(screened)
            seen.add(key)
    return kept[: POLISHED if kept and kept[0].evidence > none + WORTH_AN_EFFECT else 2]
