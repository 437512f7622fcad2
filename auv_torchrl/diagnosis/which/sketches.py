"""Look for several effects at once: explanations fitted along the measured motion, one effect more at a time.

Where two effects act, a simulation with one of them alone is far from what was measured, and says little about the
other. Along the measured motion the forces of all effects are exact, so that the second one shows.
"""

from auv_torchrl.diagnosis.which.bench import Bench
from auv_torchrl.diagnosis.which.ground import Base, Judged
from auv_torchrl.diagnosis.which.screen import Field, Screened
from auv_torchrl.effects import EFFECTS

NEAR = 1.5  # chi-square per number above which an explanation is missing something
FIRSTS = 8  # single effects
GROWN = (3, 1)  # explanations of one and of two effects that are grown
MORE = 6  # effects that are added to each, one at a time
CLOSES = 0.15  # of the chi-square beyond noise that one more effect must close: an unknown effect is not to be
# pieced together from many known ones


def is_near(chi2: float, numbers: int) -> bool:
    """Whether an explanation leaves so little that further effects would be small."""
    return chi2 < NEAR * numbers


def sketch_explanations(bench: Bench, follow: Base, field: Field, families: list[Screened]) -> list[Judged]:
    """Explanations by one effect, by two where one is not enough, by three where two are not; the likeliest first."""
    sketches = _sketched(bench, follow, families, field.twins, FIRSTS)
    for effects, grown in enumerate(GROWN, start=1):
        sketches.sort(key=lambda sketch: -sketch.evidence)
        for start in [s for s in sketches if len(s.explanation.effects) == effects][:grown]:
            if is_near(sketches[0].chi2, sketches[0].quadratic.numbers):
                return sketches
            around = start.explanation
            more = [s for s in Field.of(bench, follow, around).families() if len(s.explanation.effects) == effects + 1]
            left = CLOSES * (start.chi2 - start.quadratic.numbers)
            wider = _sketched(bench, follow, more, field.twins, MORE)
            sketches += [sketch for sketch in wider if start.chi2 - sketch.chi2 > left]
            sketches.sort(key=lambda sketch: -sketch.evidence)
    return sketches


def _sketched(
    bench: Bench, follow: Base, screened: list[Screened], twins: set[frozenset[str]], most: int
) -> list[Judged]:
    """The first of these; of effects that are the same by another name the one that the library names first."""
    names = [candidate.explanation.effects[-1] for candidate in screened]
    order = list(EFFECTS)

    def is_needless(name: str, before: tuple[str, ...]) -> bool:
        same = [other for other in {*names, *before} if frozenset({name, other}) in twins]
        return any(other in before or order.index(other) < order.index(name) for other in same)

    chosen = [s.explanation for s, name in zip(screened, names, strict=True)
              if not is_needless(name, s.explanation.effects[:-1])]  # fmt: skip
    return [bench.sketch(explanation, follow) for explanation in chosen[:most]]
