"""Look for several effects at once: explanations fitted along the measured motion, one effect more at a time.

Where two effects act, a simulation with one of them alone is far from what was measured, and says little about the
other. Along the measured motion the forces of all effects are exact, so that the second one shows.
"""

from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.identify.explanation import Explanation, Knob
from auv_torchrl.diagnosis.identify.fit import fit_along_motion
from auv_torchrl.diagnosis.identify.judged import Base, Judged
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.screen import Field, Screened, moves_all
from auv_torchrl.diagnosis.identify.valley import moved_in_valley
from auv_torchrl.diagnosis.thresholds import (
    CLOSES,
    GROWN,
    MOST_SKETCHED,
    NEAR,
    SKETCHED,
    THRESHOLD_REACH,
    TURNED_ROUND,
)
from auv_torchrl.effects import EFFECTS


def is_near(chi2: float, numbers: int) -> bool:
    """Whether an explanation leaves so little that further effects would be small."""
    return chi2 < NEAR * numbers


def sketch_explanations(problem: Problem, follow: Base, field: Field, families: list[Screened]) -> list[Judged]:
    """Explanations by one effect, by two where one is not enough, by three where two are not; the likeliest first."""
    sketches = _sketched(problem, follow, families, field.twins, MOST_SKETCHED[0])
    for effects in range(1, len(MOST_SKETCHED)):
        sketches.sort(key=lambda sketch: -sketch.evidence)
        if is_near(sketches[0].chi2, sketches[0].quadratic.numbers):
            break
        starts = [s for s in sketches if len(s.explanation.effects) == effects][: GROWN[effects - 1]]
        grown, least = _grown(problem, follow, starts), min(sketch.chi2 for sketch in sketches)
        sketches += _sketched(problem, follow, grown, field.twins, MOST_SKETCHED[effects], least)
    return sorted(sketches, key=lambda sketch: -sketch.evidence)


def _grown(problem: Problem, follow: Base, starts: list[Judged]) -> list[Screened]:
    """Explanations with one effect more that promise to close much of what is left, each set of effects once."""
    grown: dict[frozenset[str], Screened] = {}
    for start in starts:
        enough = start.chi2 - CLOSES * (start.chi2 - start.quadratic.numbers)
        for screened in Field.of(problem, follow, start.explanation).families():
            effects = frozenset(screened.explanation.effects)
            better = effects not in grown or screened.evidence > grown[effects].evidence
            if len(effects) > len(start.explanation.effects) and screened.chi2 < enough and better:
                grown[effects] = screened
    return sorted(grown.values(), key=lambda screened: -screened.evidence)


def _sketched(
    problem: Problem,
    follow: Base,
    screened: list[Screened],
    twins: set[frozenset[str]],
    most: int,
    least: float = np.inf,
) -> list[Judged]:
    """The first of these; of effects that are the same by another name the one that the library names first.

    What comes nowhere near the ``least`` chi-square that is known by then is not simulated, and not fitted to the end.
    """
    names = [candidate.explanation.effects[-1] for candidate in screened]
    order = list(EFFECTS)

    def is_needless(name: str, before: tuple[str, ...]) -> bool:
        same = [other for other in {*names, *before} if frozenset({name, other}) in twins]
        return any(other in before or order.index(other) < order.index(name) for other in same)

    chosen = [s.explanation for s, name in zip(screened, names, strict=True)
              if not is_needless(name, s.explanation.effects[:-1])]  # fmt: skip
    sketches = []
    for explanation in chosen[:most]:
        sketch = fit_along_motion(problem, explanation, follow, enough=TURNED_ROUND * least)
        if np.isfinite(least):
            sketch = _plainer(problem, follow, sketch, least)
            sketch = _along_valleys(problem, follow, sketch, least)
            least = min(least, sketch.chi2)
        sketches.append(sketch)
    return sketches


def _plainer(problem: Problem, follow: Base, sketch: Judged, least: float) -> Judged:
    """A promising sketch, or one with one value in place of most of a family's own, where the log speaks for that.

    A limit that was brought to 0 beside an unknown effect does not come back from there, where no slope shows it, and
    what its thruster lacks then looks like a third effect.
    """
    for effect in sketch.explanation.effects:
        if not sketch.chi2 < TURNED_ROUND * least:  # also where it diverged
            break
        shared = _with_one_value(problem, sketch.explanation, effect)
        if shared is not None:
            other = fit_along_motion(problem, shared, follow, enough=TURNED_ROUND * least)
            sketch = max(sketch, other, key=lambda one: one.evidence)
    return sketch


def _with_one_value(problem: Problem, explanation: Explanation, effect: str) -> Explanation | None:
    """The explanation with one value for all members of a family, the median; None where few have one of their own."""
    atoms = [atom for atom in problem.atoms if atom.effect == effect and moves_all(problem, atom)]
    for members in dict.fromkeys(tuple(atom.values) for atom in atoms):
        own = [knob for knob in explanation.knobs if knob.effect == effect and set(knob.members) < set(members)]
        if 2 * len(own) > len(members):
            shared = Knob(effect, members, float(np.median([knob.value for knob in own])))
            return replace(explanation, knobs=(*(knob for knob in explanation.knobs if knob not in own), shared))
    return None


def _along_valleys(problem: Problem, follow: Base, sketch: Judged, least: float) -> Judged:
    """A promising sketch, walked along the valleys of its effects, where a fit by slopes stops on the side.

    What the one effect of a valley does not reach there looks like a third effect.
    """
    for name in sketch.explanation.effects:
        valley = EFFECTS[name].valley
        if valley is None or valley.beside[0] not in sketch.explanation.effects:
            continue
        step = THRESHOLD_REACH[0] * problem.prior.width(name, valley.leading)
        for stride in (step, -step):
            while sketch.chi2 < TURNED_ROUND * least:
                moved = moved_in_valley(problem, sketch.explanation, valley, stride)
                trial = fit_along_motion(problem, moved, follow, enough=TURNED_ROUND * sketch.chi2)
                if not trial.chi2 < (1 - SKETCHED) * sketch.chi2:
                    break
                sketch = trial
    return sketch
