"""Find the explanation: screen everything, polish what could be it, add and take out effects while the log pays."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from auv_torchrl.diagnosis.which.bench import Bench
from auv_torchrl.diagnosis.which.explanation import Explanation
from auv_torchrl.diagnosis.which.ground import Base, Judged
from auv_torchrl.diagnosis.which.screen import Field, Screened
from auv_torchrl.diagnosis.which.sketches import CLOSES, is_near, sketch_explanations
from auv_torchrl.effects import EFFECTS

POLISHED = 4  # candidates that are simulated
WITHIN = 0.25  # of the evidence gained by the best, plus EVIDENCE_SLIP: what screening may misjudge
EVIDENCE_SLIP = 40.0
AS_GOOD = 2.0  # times the chi-square of the best sketch: what simulation may turn round
MISSED = 1.0  # chi-square per number that comes back without an effect that is not needless
CONTENDS = 100.0  # log evidence that a fit that leaves nothing may still be away from its best ...
ADDS = 20.0  # ... and by which one that only adds effects to the best may be worse
FITTED_ON = 3  # times at most, of rivals, while each gains ...
STILL = 1.0  # ... this log evidence
HOPELESS = 60.0  # log evidence against "no gap" beyond which its slack need not be fitted
IDLE = 2.0  # standard deviations, of the estimate or of slack
TRIED = 3  # further effects that are simulated where much is left, of those that promise about the same
EASED = 0.2  # of what the screening says of an effect: the start of a fit that went astray from the whole of it
WORTH = 5.0  # log evidence that one more effect must bring
TIE = 3.0  # log evidence that does not speak for more values
MOST_EFFECTS = 3
FEW = 4  # values

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Found:
    """What the search leaves behind."""

    follow: Base  # nominal vehicle, the gap in a free force
    none: Judged
    best: Judged
    polished: list[Judged]  # all that were simulated, the best first
    screened: list[Screened]  # every family alone
    field: Field  # marks of all changes at the nominal vehicle
    promise: float  # chi-square per number that the best look along the measured motion leaves; infinite without one


def search(
    bench: Bench, follow: Base, progress: Progress, hints: Sequence[Explanation] = (), below: float = np.inf
) -> Found:
    """Explain the windows of a bench that ``follow`` has followed.

    ``hints`` are simulated first, and what the screening finds only where none of them explains the log by a few
    values, and where it promises to leave less than ``below`` of chi-square per number. With 0 all hints are simulated,
    and nothing else.
    """
    field = Field.of(bench, follow)
    families = field.families()
    progress("screening effects", 0.4)
    hopeless = field.none().evidence < families[0].evidence - HOPELESS
    polished = [bench.polish(Explanation(), follow, rounds=0 if hopeless else 4)]  # without any effect, then with some
    bench.slack_suffices = not bench.leaves_much(polished[0])
    promise = np.inf
    for explanation in hints:
        polished.append(bench.polish(explanation, follow))
        if below and len(explanation.knobs) <= FEW and not bench.leaves_much(polished[-1]):
            break
    else:
        candidates: Sequence[Screened | Judged] = ()
        if below:
            one_does = any(len(j.explanation.effects) == 1 and not bench.leaves_much(j) for j in polished[1:])
            below = np.inf if one_does else below
            candidates, promise = _candidates(bench, follow, field, families, one_does)
        for shown in candidates if promise < below else ():
            enough = AS_GOOD * min(judged.chi2 for judged in polished)
            polished.append(bench.polish(shown.explanation, follow, enough=enough))
            progress("fitting candidates", min(0.7, 0.4 + 0.3 * len(polished) / POLISHED))
    best = _best(bench, polished)
    if bench.measure_noise(best):
        polished = [bench.again(judged) if np.isfinite(judged.chi2) else judged for judged in polished]
        best = _best(bench, polished)
    if not bench.leaves_much(best):
        polished = _fitted_on(bench, best, polished, field.twins)
        best = _best(bench, polished)
    given_up = below <= promise < np.inf
    if not given_up and (not best.nothing_left or bench.is_strained(best)):
        best = _grow(bench, best, polished, field.twins, progress)
    best = _prune(bench, best, polished)
    best = _drop_idle(bench, best, polished)
    if not best.nothing_left:
        polished.append(bench.polish(best.explanation, best.base))
        best = max(best, polished[-1], key=lambda judged: judged.evidence)
    best = _simplest(bench, best, polished)
    ranked = sorted(polished, key=lambda judged: -judged.evidence)
    return Found(follow, polished[0], best, ranked, families, field, promise)


def _fitted_on(bench: Bench, best: Judged, polished: list[Judged], twins: set[frozenset[str]]) -> list[Judged]:
    """What may still win is fitted until nothing moves: a fit that leaves nothing is good, but not yet the best."""

    def contends(judged: Judged) -> bool:
        own, its = set(best.explanation.effects), set(judged.explanation.effects)
        far = ADDS if own < its else CONTENDS
        return own != its and frozenset(own ^ its) not in twins and judged.evidence > best.evidence - far

    rivals = [judged for judged in polished if contends(judged)]
    if not rivals or not best.explanation.effects:
        return polished
    fitted = {id(best): _until_still(bench, best)}
    for rival in rivals:
        fitted[id(rival)] = _until_still(bench, _from_best(bench, rival, fitted[id(best)]))
    return [fitted.get(id(judged), judged) for judged in polished]


def _from_best(bench: Bench, rival: Judged, best: Judged) -> Judged:
    """A rival, or its fit from the slack and the shared values of the best where that is better: one may be stuck."""
    trial = bench.polish(rival.explanation.starting_from(best.explanation), best.base)
    return trial if trial.evidence > rival.evidence else rival


def _until_still(bench: Bench, judged: Judged) -> Judged:
    for _ in range(FITTED_ON):
        further = bench.polish(judged.explanation, judged.base)
        if not further.evidence > judged.evidence + STILL:
            break
        judged = further
    return judged


def _best(bench: Bench, polished: list[Judged]) -> Judged:
    none = polished[0].evidence
    pays = [j for j in polished[1:] if j.evidence > none + WORTH and not bench.minor(j)]
    return max(pays, key=lambda judged: judged.evidence, default=polished[0])


def _simplest(bench: Bench, best: Judged, polished: list[Judged]) -> Judged:
    """Of what fits about as well as the best, the explanation with the fewest values."""
    close = [j for j in polished if j.explanation.effects and j.evidence > best.evidence - TIE and not bench.minor(j)]
    if not best.explanation.effects:
        return best
    return min([best, *close], key=lambda judged: (len(judged.explanation.knobs), -judged.evidence))


def _candidates(
    bench: Bench, follow: Base, field: Field, families: list[Screened], one_does: bool
) -> tuple[Sequence[Screened | Judged], float]:
    """What to simulate, and the chi-square per number that the best of it promises to leave.

    They are single effects, or where none comes near, and none is known to do, what a look along the measured motion
    shows.
    """
    numbers = field.quadratic.numbers
    if one_does or is_near(families[0].chi2, numbers):
        return _promising(field, families), families[0].chi2 / numbers
    sketches = sketch_explanations(bench, follow, field, families)
    as_good = [sketch for sketch in sketches if sketch.chi2 < AS_GOOD * sketches[0].chi2]
    return _promising(field, as_good), sketches[0].chi2 / numbers


def _drop_idle(bench: Bench, best: Judged, polished: list[Judged]) -> Judged:
    """Take out values that stand where they would without the effect."""
    slack = {(effect, member): width for effect, member, _, width in bench.slack}
    deviation = iter(np.sqrt(np.diag(best.covariance)))
    kept = []
    for knob in best.explanation.knobs:
        if knob.discrete:
            kept.append(knob)
            continue
        nominal = EFFECTS[knob.effect].nominal(bench.vehicle)[knob.members[0]]
        doubt = max(float(next(deviation)), slack.get((knob.effect, knob.members[0]), 0.0))
        if abs(knob.value - nominal) > IDLE * doubt:
            kept.append(knob)
    if not kept or len(kept) == len(best.explanation.knobs):
        return best
    fewer = bench.polish(replace(best.explanation, knobs=tuple(kept)), best.base)
    polished.append(fewer)
    return fewer if fewer.evidence > best.evidence - WORTH else best


def _promising(field: Field, ranked: Sequence[Screened | Judged]) -> list[Screened | Judged]:
    """The few that may turn out best once simulated, best first."""
    none = field.none().evidence
    least = ranked[0].evidence - EVIDENCE_SLIP - WITHIN * max(0.0, ranked[0].evidence - none)
    if field.bench.layout.moves_unseen:  # a large tilt that nobody measured is far from where the marks were taken
        least = -np.inf
    kept, seen = [], set()
    for screened in ranked:
        key = frozenset(screened.explanation.effects)
        dominated = any(known < key for known in seen)  # the extra effect is added later if it pays
        if screened.evidence > max(least, none - EVIDENCE_SLIP / 4) and key not in seen and not dominated:
            kept.append(screened)
            seen.add(key)
    return kept[: POLISHED if kept and kept[0].evidence > none + WORTH else 2]


def _grow(bench: Bench, best: Judged, polished: list[Judged], twins: set[frozenset[str]], progress: Progress) -> Judged:
    while len(best.explanation.effects) < MOST_EFFECTS:
        progress("looking for further effects", 0.7 + 0.05 * len(best.explanation.effects))
        field = Field.of(bench, best.base)
        here = field.none().evidence
        twins_of = {name for pair in twins for name in pair if pair & set(best.explanation.effects)}
        fresh_ones = (
            s for s in field.families() if not (set(s.explanation.effects) - set(best.explanation.effects)) & twins_of
        )
        tried = TRIED if bench.leaves_much(best) else 1
        ahead = sorted(fresh_ones, key=lambda screened: -screened.evidence)[:tried]
        left = best.chi2 - best.quadratic.numbers if bench.leaves_much(best) else 0.0
        least = max(here + WORTH, ahead[0].evidence - WITHIN * (ahead[0].evidence - here)) if ahead else 0.0
        trials = [s for s in ahead if s.evidence > least and field.constant - s.chi2 > CLOSES * left]
        fresh = [_added(bench, best, s.explanation) for s in trials]
        polished += fresh
        better = max((j for j in fresh if not bench.minor(j)), key=lambda judged: judged.evidence, default=best)
        if better.evidence <= best.evidence + WORTH or best.chi2 - better.chi2 < CLOSES * left:
            return best
        best = better
        if best.nothing_left:
            return best
    return best


def _added(bench: Bench, best: Judged, explanation: Explanation) -> Judged:
    """An explanation that adds an effect to the best; where that made it worse, from a small amount of the effect."""
    judged = bench.polish(explanation, best.base)
    if judged.chi2 <= best.chi2:
        return judged
    eased = {}
    for place, knob in enumerate(explanation.knobs):
        nominal = EFFECTS[knob.effect].nominal(bench.vehicle)[knob.members[0]]
        if not knob.discrete:
            eased[place] = nominal + EASED * (knob.value - nominal)
    again = bench.polish(explanation.moved(eased).starting_from(best.explanation), best.base)
    return max(judged, again, key=lambda judged: judged.evidence)


def _prune(bench: Bench, best: Judged, polished: list[Judged]) -> Judged:
    while len(best.explanation.effects) > 1:
        fewer = [_without(bench, best, effect) for effect in best.explanation.effects]
        polished += fewer
        better = max(fewer, key=lambda judged: judged.evidence)
        if better.evidence <= best.evidence - WORTH:
            return best
        best = better
    return best


def _without(bench: Bench, best: Judged, effect: str) -> Judged:
    """The explanation without an effect, simulated where a sketch does not show that it is far worse."""
    sketch = bench.sketch(best.explanation.without(effect), best.base)
    far = sketch.chi2 > best.chi2 + MISSED * sketch.quadratic.numbers
    return sketch if far else bench.polish(sketch.explanation, best.base)
