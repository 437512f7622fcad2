"""What the judgements say about vehicles whose file is wrong, of which healthy flights were given."""

from collections.abc import Iterable, Sequence

from auv_torchrl.effects import EFFECTS
from benchmarks.blind.scores.judge import Judgement
from benchmarks.blind.scores.score import by_family as scores_by_family
from benchmarks.blind.scores.score import failed, failure, of_families, outside
from benchmarks.blind.scores.table import Share, Table, counted, median, median_and_largest, number, targets
from benchmarks.scoring import Score


def stranger_tables(judgements: Sequence[Judgement], flights: int) -> list[Table]:
    """All of them, in the order in which they are read."""
    every = (scores_by_family, by_effect, by_stranger, outside, wrong)
    return [stranger_numbers(judgements, flights), *(table(judgements) for table in every)]


def stranger_numbers(judgements: Sequence[Judgement], flights: int) -> Table:
    """The targets with what was measured."""
    single, pairs = of_families(judgements, "single"), of_families(judgements, "pair")
    healthy, unknown = of_families(judgements, "no_gap"), of_families(judgements, "outside")
    numbered = Share.of(j.thrusters_right for j in single)
    covered = [held for j in judgements for held in j.covered.values()]
    errors = [error for j in single for error in j.errors.values()]
    seconds = median_and_largest([j.cpu_s for j in judgements])
    rows = [
        ("single effect: named, and nothing else", "≥ 85 %", "≥ 95 %", Share.of([_alone(j) for j in single])),
        ("… or one declared indistinguishable from it", "", "", Share.of([_declared(j) for j in single])),
        ("… named first, whatever else is named", "", "", Share.of([j.right for j in single])),
        ("thrusters at fault named (exchangeable ones declared)", "≥ 95 %", "≥ 99 %", numbered),
        ("pairs: both found, and nothing else", "", "", Share.of([j.right for j in pairs])),
        ("… up to what was declared indistinguishable", "", "", Share.of([j.right_class for j in pairs])),
        ("no gap: false alarms", "≤ 5 %", "≤ 2 %", Share.of([j.verdict != "no_gap" for j in healthy])),
        ("outside the library: not called explained", "≥ 85 %", "≥ 95 %", Share.of([j.right for j in unknown])),
        ("95 % intervals that hold the truth", "88 to 99 %", "92 to 98 %", Share.of(covered)),
        ("parameter error, median", "", "", number(errors, median, ".1%")),
        ("CPU seconds per log, calibration included, median / largest", "", "", seconds),
    ]
    return targets(f"Strangers, {flights} healthy flights", rows)


def by_effect(judgements: Iterable[Judgement]) -> Table:
    """Single effects of strangers."""
    cases = of_families(judgements, "single")
    rows = []
    for name in EFFECTS:
        if mine := [j for j in cases if j.truth == name]:
            errors = [error for j in mine for error in j.errors.values()]
            rows.append(
                (
                    name,
                    Share.of(_alone(j) for j in mine).fraction,
                    Share.of(j.thrusters_right for j in mine).fraction,
                    f"{median(errors):.1%}" if errors else "–",
                    counted(j.answered for j in mine if not _alone(j)),
                )
            )
    head = ("effect", "named, and nothing else", "thrusters", "median parameter error", "instead")
    return Table("Single effects of strangers", head, rows)


def by_stranger(judgements: Iterable[Judgement]) -> Table:
    """Each vehicle with what was right about it."""
    judgements = list(judgements)
    rows = []
    for stranger in sorted({j.stranger for j in judgements if j.stranger is not None}):
        mine = [j for j in judgements if j.stranger == stranger]
        seconds = median_and_largest([j.cpu_s for j in mine])
        rows.append((str(stranger), mine[0].plant, Share.of(_alone(j) for j in mine).fraction, seconds))
    head = ("stranger", "simulator", "right, and nothing else named", "CPU seconds, median / largest")
    return Table("Vehicles", head, rows)


def wrong(judgements: Iterable[Judgement]) -> Table:
    """Every case of which the answer is not the truth and nothing else."""
    rows = []
    for j in judgements:
        wrong_thrusters = j.thrusters_right is False
        if j.score == Score.RIGHT.name.lower() and _alone(j) and not wrong_thrusters:
            continue
        answer = j.answered + (" (other thrusters)" if wrong_thrusters else "")
        answer += " (declared)" if _declared(j) and not _alone(j) else ""
        rows.append(failure(j, str(j.stranger), j.outside or " + ".join(j.effects) or j.truth, answer))
    return failed("stranger", rows)


def _alone(judgement: Judgement) -> bool:
    """Whether the answer is right and names nothing beside the truth."""
    return judgement.right and _as_many(judgement)


def _declared(judgement: Judgement) -> bool:
    return judgement.right_class and _as_many(judgement)


def _as_many(judgement: Judgement) -> bool:
    return judgement.truth == "unknown" or len(judgement.named) == len(judgement.effects)
