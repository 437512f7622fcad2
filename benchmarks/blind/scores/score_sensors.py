"""What the judgements say about a vehicle with a set of sensors."""

from collections.abc import Iterable, Sequence

import numpy as np

from auv_torchrl.effects import EFFECTS, get_effect
from benchmarks.blind.flights.sensor_sets import FAULTS, LOAD, THRUSTER, UNSEEN
from benchmarks.blind.scores.judge import Judgement
from benchmarks.blind.scores.score import failures, scores
from benchmarks.blind.scores.table import Share, Table, counted, median, median_and_largest, number, targets

LEAST = {"stock": ("≥ 90 %", "≥ 97 %"), "dvl": ("≥ 95 %", "≥ 99 %"), "mocap": ("", "")}  # of what is named: must, aim
ALARMS = ("≤ 3 %", "≤ 1 %")
NOTHING = "nothing wrong"


def set_tables(judgements: Sequence[Judgement], sensors: str) -> list[Table]:
    """All of them, in the order in which they are read."""
    scored = scores(judgements, ((fault or NOTHING, _of(judgements, [fault])) for fault in (*FAULTS, None)))
    return [set_numbers(judgements, sensors), scored, by_fault(judgements), shown(judgements), failures(judgements)]


def set_numbers(judgements: Sequence[Judgement], sensors: str) -> Table:
    """The targets with what was measured."""
    named = LEAST[sensors]
    thrusters, loads = _of(judgements, THRUSTER), _of(judgements, LOAD)
    offsets = _of(judgements, [UNSEEN])
    healthy = [j for j in judgements if j.fault is None]
    errors = [error for j in judgements for error in j.errors.values()]
    covered = [held for j in judgements for held in j.covered.values()]
    numbered = Share.of([_with_number(j) for j in thrusters])
    declared, first = (Share.of([getattr(j, name) for j in loads]) for name in ("right_class", "right"))
    told = Share.of([j.right_class for j in offsets])
    rows = [
        ("dead, reversed or weak thruster named first, with its number", *named, numbered),
        ("buoyancy, payload: named first, or declared indistinguishable", *named, declared),
        ("… named first", "", "", first),
        ("depth bias: named, or said that no log of these sensors shows it", *named, told),
        ("no gap: false alarms", *ALARMS, Share.of([j.verdict != "no_gap" for j in healthy])),
        ("something else named, for more likely than not", "", "", Share.of([_blamed(j) for j in judgements])),
        ("95 % intervals that hold the truth", "", "", Share.of(covered)),
        ("parameter error, median", "", "", number(errors, median, ".1%")),
        ("CPU seconds per log, median / largest", "", "", median_and_largest([j.cpu_s for j in judgements])),
    ]
    return targets(f"Sensors: {sensors}", rows)


def by_fault(judgements: Iterable[Judgement]) -> Table:
    """Each fault, without and with slack."""
    judgements = list(judgements)
    rows = []
    for fault in FAULTS:
        if mine := _of(judgements, [fault]):
            errors = [error for j in mine for error in j.errors.values()]
            rows.append(
                (
                    fault,
                    Share.of(j.right for j in mine).fraction,
                    Share.of(j.thrusters_right for j in mine).fraction,
                    f"{median(errors):.1%}" if errors else "–",
                    counted(j.answered for j in mine if not j.right),
                )
            )
    return Table("Faults", ("fault", "named first", "thrusters", "median parameter error", "instead"), rows)


def shown(judgements: Iterable[Judgement]) -> Table:
    """Of healthy flights, the smallest size of each effect that they would have shown."""
    healthy = [j for j in judgements if j.verdict == "no_gap" and (j.sizes or j.unseen)]
    rows = []
    for name in EFFECTS:
        sizes = [j.sizes[name] for j in healthy if name in j.sizes]
        if sizes:
            units = sorted({p.unit for p in get_effect(name).parameters if not p.discrete})
            rows.append((name, f"{np.median(sizes):.2g}", units[0] if len(units) == 1 and units[0] != "1" else ""))
        elif any(name in j.unseen for j in healthy):
            rows.append((name, "never", ""))
    head = ("effect", "smallest size that a log without a gap would have shown, median", "unit")
    return Table("What these sensors can show", head, rows)


def _of(judgements: Iterable[Judgement], faults: Iterable[str | None]) -> list[Judgement]:
    wanted = set(faults)
    return [j for j in judgements if j.fault in wanted]


def _with_number(judgement: Judgement) -> bool:
    return judgement.right and bool(judgement.thrusters_right)


def _blamed(judgement: Judgement) -> bool:
    """Whether the first effect named is neither the truth nor declared beside it."""
    return bool(judgement.named) and not judgement.right_class and (judgement.probability or 0.0) > 0.5
