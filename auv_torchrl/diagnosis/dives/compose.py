"""From what was found over many dives to what is said about them."""

from collections.abc import Mapping, Sequence

import numpy as np

from auv_torchrl.diagnosis.dives.answer import (
    AlarmTold,
    ChangeTold,
    DiveTold,
    Followed,
    ManyDives,
    OwnDiagnosis,
    ShiftTold,
    Value,
)
from auv_torchrl.diagnosis.dives.changes import Alarm, Change, Judged
from auv_torchrl.diagnosis.dives.said import change_sentence, label_of, summary_of
from auv_torchrl.diagnosis.dives.series import Series
from auv_torchrl.diagnosis.dives.shifts import Shift
from auv_torchrl.diagnosis.dives.told import NOISE, Dive, Normal, Number
from auv_torchrl.diagnosis.thresholds import LIKELY, Z95
from auv_torchrl.diagnosis.verdict import how_sure
from auv_torchrl.effects import EFFECTS
from auv_torchrl.flightlog import Finding
from auv_torchrl.vehicle import Vehicle


# long: one answer, put together field by field
def compose(
    dives: Sequence[Dive],
    normal: Normal,
    judged: Judged,
    vehicle: Vehicle,
    vehicle_name: str,
    dives_per_false_alarm: float,
    excess: float,
    diagnoses: Mapping[int, OwnDiagnosis],
    besides: Sequence[Finding] = (),
) -> ManyDives:
    """What is said.

    Args:
        dives: in their order, the reference first.
        normal: the sound vehicle.
        judged: what changed.
        vehicle: as its file says; for advice.
        vehicle_name: for people.
        dives_per_false_alarm: that the threshold was made for.
        excess: chi-square per number from which a dive is not explained.
        diagnoses: of single dives, by number from 0.
        besides: what there is to say of the folder of the dives.
    """
    series = judged.series
    told = [
        DiveTold(
            t + 1,
            dive.name,
            dive.begun,
            dive.seconds,
            t < judged.reference and not dive.refused,
            dive.excess,
            dive.explained(excess),
            dive.refused,
            {
                number.key: _value(series.value[row, t], np.sqrt(series.variance[row, t]))
                for row, number in enumerate(series.numbers)
                if series.told[row, t]
            },
            dive.findings,
            diagnoses.get(t),
        )
        for t, dive in enumerate(dives)
    ]
    changes = tuple(_change(change, series, vehicle) for change in judged.changes)
    labels = {number.key: label_of(number) for number in series.numbers}
    alarms = tuple(_alarm(alarm, series.numbers) for alarm in judged.alarms)
    return ManyDives(
        vehicle=vehicle_name,
        summary=summary_of(changes, labels, alarms, told),
        dives=tuple(told),
        numbers=tuple(Followed(n.key, n.effect, label_of(n), n.unit, n.watched) for n in series.numbers),
        alarms=alarms,
        changes=changes,
        dives_per_false_alarm=dives_per_false_alarm,
        threshold=judged.threshold,
        cannot_tell=tuple(_cannot_tell(series.numbers, series.told)),
        findings=(*besides, *normal.findings),
    )


def _value(value: float, deviation: float) -> Value:
    return Value(float(value), float(value - Z95 * deviation), float(value + Z95 * deviation))


def _change(change: Change, series: Series, vehicle: Vehicle) -> ChangeTold:
    numbers, spread = series.numbers, series.variance[change.number]
    number, line = numbers[change.number], change.at(np.arange(len(spread)))
    moments = tuple(_shift(shift) for shift in change.shifts)
    now = float(line[-1])
    is_back = len(moments) > 1 and abs(now) < Z95 * float(np.sqrt(spread[np.isfinite(spread)][-1]))
    return ChangeTold(
        number=number.key,
        shifts=moments,
        now=now,
        line=tuple(line.tolist()),
        probability=change.probability,
        rivals=tuple(numbers[row].key for row in change.rivals),
        sentence=how_sure(
            change_sentence(number, moments, now, is_back, [numbers[row] for row in change.rivals]), change.probability
        ),
        advice=() if is_back or change.probability <= LIKELY else _advice(number, now, vehicle),
    )


def _shift(shift: Shift) -> ShiftTold:
    return ShiftTold(
        "drift" if shift.is_drift else "step",
        shift.begin + 1,
        shift.low + 1,
        shift.high + 1,
        _value(shift.size, shift.deviation),
        shift.probability,
    )


def _alarm(alarm: Alarm, numbers: Sequence[Number]) -> AlarmTold:
    label, others = label_of(numbers[alarm.number]), [label_of(numbers[row]) for row in alarm.rivals]
    sentence = f"{' or '.join([label, *others])} is not as before"
    return AlarmTold(alarm.dive + 1, numbers[alarm.number].key, tuple(numbers[r].key for r in alarm.rivals), sentence)


def _advice(number: Number, now: float, vehicle: Vehicle) -> tuple[str, ...]:
    """What to do about a number of the vehicle, where its effect says so."""
    if number.effect == NOISE:
        return ()
    p = EFFECTS[number.effect].member_parameters(vehicle)[number.member]
    value = min(max(number.nominal + now, p.low), p.high)
    return tuple(advice.do for advice in EFFECTS[number.effect].advise(vehicle, {number.member: value}, {}))


def _cannot_tell(numbers: Sequence[Number], told: np.ndarray) -> list[str]:
    never = [label_of(number) for number, seen in zip(numbers, told, strict=True) if not seen.any()]
    rough = [label_of(n) for n, seen in zip(numbers, told, strict=True) if n.is_rough and seen.any()]
    found = [f"no dive tells {', '.join(never)}"] if never else []
    if rough:
        found.append(f"{', '.join(rough)}: shown, but not watched, because slopes do not tell what it does")
    return found
