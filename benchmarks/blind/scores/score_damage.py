"""What the judgements say about damaged logs."""

from collections.abc import Iterable, Sequence

from benchmarks.blind.flights.damages import DAMAGES
from benchmarks.blind.scores.judge import Judgement
from benchmarks.blind.scores.table import Share, Table, counted


def damage_targets(judgements: Sequence[Judgement]) -> list[tuple[str, str, str, Share]]:
    """Rows of the table of targets: claim, must, aim, measured."""
    cases = [j for j in judgements if j.damage]
    found = Share.of(j.fault_found for j in cases)
    return [
        ("damaged log: something sound blamed", "≤ 2 %", "", Share.of([bool(j.wrong_causes) for j in cases])),
        ("damaged log: the damage named", "≥ 90 %", "", Share.of([bool(j.damage_named) for j in cases])),
        ("fault beside a damage that leaves it visible: found", "≥ 80 %", "", found),
    ]


def by_damage(judgements: Iterable[Judgement]) -> Table:
    """Each damage, with and without a fault beside it."""
    cases = [j for j in judgements if j.damage]
    rows = []
    for name in DAMAGES:
        if mine := [j for j in cases if j.damage == name]:
            rows.append(
                (
                    name.replace("_", " "),
                    str(len(mine)),
                    counted(cause for j in mine for cause in j.wrong_causes or ()),
                    Share.of(bool(j.damage_named) for j in mine).fraction,
                    Share.of(j.fault_found for j in mine).fraction,
                    counted(j.answered for j in mine if not j.damage_named),
                )
            )
    head = ("damage", "logs", "sound things blamed", "damage named", "fault found", "named instead")
    return Table("Damaged logs", head, rows)
