"""What the judgements say about damaged logs."""

from collections import Counter
from collections.abc import Iterable, Sequence

from benchmarks.blind.damages import DAMAGES
from benchmarks.blind.judge import Judgement
from benchmarks.blind.statistics import Share
from benchmarks.blind.table import Table


def damage_targets(judgements: Sequence[Judgement]) -> list[tuple[str, str, str, Share]]:
    """Rows of the table of targets: claim, must, aim, measured."""
    cases = [j for j in judgements if j.damage]
    found = [j.fault_found for j in cases if j.fault_found is not None]
    return [
        ("damaged log: something sound blamed", "≤ 2 %", "", Share.of([bool(j.wrong_causes) for j in cases])),
        ("damaged log: the damage named", "≥ 90 %", "", Share.of([bool(j.damage_named) for j in cases])),
        ("fault beside a damage that leaves it visible: found", "≥ 80 %", "", Share.of(found)),
    ]


def by_damage(judgements: Iterable[Judgement]) -> Table:
    """Each damage, with and without a fault beside it."""
    cases = [j for j in judgements if j.damage]
    rows = []
    for name in DAMAGES:
        if mine := [j for j in cases if j.damage == name]:
            found = [j.fault_found for j in mine if j.fault_found is not None]
            wrong = Counter(cause for j in mine for cause in j.wrong_causes or ())
            rows.append(
                (
                    name.replace("_", " "),
                    str(len(mine)),
                    ", ".join(f"{cause} {n}" for cause, n in wrong.most_common()),
                    f"{sum(bool(j.damage_named) for j in mine)}/{len(mine)}",
                    f"{sum(found)}/{len(found)}" if found else "",
                    ", ".join(f"{answer} {n}" for answer, n in _instead(mine).most_common()),
                )
            )
    head = ("damage", "logs", "sound things blamed", "damage named", "fault found", "named instead")
    return Table("Damaged logs", head, rows)


def _instead(cases: Iterable[Judgement]) -> Counter[str]:
    """What was answered where the damage was not named."""
    return Counter(" + ".join(j.named) or j.verdict for j in cases if not j.damage_named)
