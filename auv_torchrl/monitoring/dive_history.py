"""The report over many dives: the content of ``dives.json``, its sentences, and how the report is put together."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from auv_torchrl.diagnosis.command.logs import BESIDES
from auv_torchrl.diagnosis.report.wording import sentence
from auv_torchrl.diagnosis.thresholds import LIKELY, Z95
from auv_torchrl.diagnosis.verdict import how_sure
from auv_torchrl.effects import EFFECTS
from auv_torchrl.flightlog import Finding
from auv_torchrl.monitoring.changes import Alarm, Change, ChangeRecord, ParameterSeries
from auv_torchrl.monitoring.dive_record import NOISE, Baseline, Dive, TrackedParameter
from auv_torchrl.monitoring.shifts import Shift
from auv_torchrl.quantities import counted, percent, quantity, words
from auv_torchrl.vehicle import Vehicle

MOST_NAMED = 3  # changes, rivals or dives in one sentence


@dataclass(frozen=True)
class Deviation:
    """A deviation from the reference with its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class ParameterEntry:
    """A parameter that is tracked from dive to dive."""

    key: str
    effect: str  # in auv_torchrl.effects.EFFECTS, or "noise"
    label: str  # for people
    unit: str  # "1" where it has none; its deviations are then shown in per cent
    watched: bool  # a change of it raises an alarm


@dataclass(frozen=True)
class DiveDiagnosis:
    """The result of the diagnosis of one dive by itself."""

    verdict: str
    summary: str
    folder: str  # beside dives.json


@dataclass(frozen=True)
class DiveEntry:
    """One dive."""

    number: int  # in the order in which they were flown, from 1
    name: str
    begun: str  # date and time; empty where the name of its file has none
    seconds: float
    is_reference: bool
    excess: float | None  # chi-square per measured number with every parameter free; 1 is noise alone
    is_explained: bool  # whether sensors and water alone make as much
    refused: str  # why the log could not be used; empty where it could
    values: dict[str, Deviation]  # by parameter; those of which the dive has no information are left out
    findings: tuple[Finding, ...] = ()
    diagnosis: DiveDiagnosis | None = None


@dataclass(frozen=True)
class ShiftEntry:
    """One step or drift of one parameter."""

    kind: str  # "step" or "drift"
    dive: int  # the first that is not as before, from 1
    dive_low: int  # 95 % interval
    dive_high: int
    size: Deviation  # of a drift, per dive
    probability: float


@dataclass(frozen=True)
class ChangeEntry:
    """What happened to one parameter, seen from the last dive."""

    number: str  # key of the parameter
    shifts: tuple[ShiftEntry, ...]
    now: float  # the deviation in the last dive, from what it was before
    line: tuple[float, ...]  # the deviation in each dive, as the shifts say
    probability: float
    rivals: tuple[str, ...]  # parameters that may have changed instead
    sentence: str
    advice: tuple[str, ...] = ()

    @property
    def is_likely(self) -> bool:
        """Whether a change is likelier than none."""
        return self.probability > LIKELY


@dataclass(frozen=True)
class AlarmEntry:
    """A change that was noticed when only the dives so far were known."""

    dive: int
    number: str  # key of the parameter
    rivals: tuple[str, ...]
    sentence: str


@dataclass(frozen=True)
class DiveHistory:
    """The whole report: the dives, the parameters, the alarms and the changes."""

    vehicle: str
    summary: str
    dives: tuple[DiveEntry, ...]
    numbers: tuple[ParameterEntry, ...]
    alarms: tuple[AlarmEntry, ...]
    changes: tuple[ChangeEntry, ...]
    dives_per_false_alarm: float
    threshold: float  # of twice the log likelihood ratio
    cannot_tell: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()  # of the reference, and of the folder of the dives

    @property
    def parameters(self) -> dict[str, ParameterEntry]:
        """The parameters by their keys."""
        return {entry.key: entry for entry in self.numbers}

    @property
    def changed(self) -> dict[str, ChangeEntry]:
        """Changes by the key of the parameter."""
        return {change.number: change for change in self.changes}


# long: one report, put together field by field
def make_history(
    dives: Sequence[Dive],
    baseline: Baseline,
    record: ChangeRecord,
    vehicle: Vehicle,
    vehicle_name: str,
    dives_per_false_alarm: float,
    excess: float,
    diagnoses: Mapping[int, DiveDiagnosis],
    besides: Sequence[Finding] = (),
) -> DiveHistory:
    """The report over many dives.

    Args:
        dives: in their order, the reference first.
        baseline: the healthy vehicle.
        record: what changed.
        vehicle: as its file says; for advice.
        vehicle_name: for people.
        dives_per_false_alarm: that the threshold was made for.
        excess: chi-square per measured number from which a dive is not explained.
        diagnoses: of single dives, by number from 0.
        besides: findings about the folder of the dives.
    """
    series = record.series
    entries = [
        DiveEntry(
            t + 1,
            dive.name,
            dive.begun,
            dive.seconds,
            t < record.reference and not dive.refused,
            dive.excess,
            dive.explained(excess),
            dive.refused,
            {
                parameter.key: _deviation(series.value[row, t], np.sqrt(series.variance[row, t]))
                for row, parameter in enumerate(series.parameters)
                if series.is_informed[row, t]
            },
            dive.findings,
            diagnoses.get(t),
        )
        for t, dive in enumerate(dives)
    ]
    changes = tuple(_change_entry(change, series, vehicle) for change in record.changes)
    labels = {parameter.key: label_of(parameter) for parameter in series.parameters}
    alarms = tuple(_alarm_entry(alarm, series.parameters) for alarm in record.alarms)
    return DiveHistory(
        vehicle=vehicle_name,
        summary=summary_of(changes, labels, alarms, entries),
        dives=tuple(entries),
        numbers=tuple(ParameterEntry(p.key, p.effect, label_of(p), p.unit, p.watched) for p in series.parameters),
        alarms=alarms,
        changes=changes,
        dives_per_false_alarm=dives_per_false_alarm,
        threshold=record.threshold,
        cannot_tell=tuple(_cannot_tell(series)),
        findings=(*besides, *baseline.findings),
    )


def _deviation(value: float, deviation: float) -> Deviation:
    return Deviation(float(value), float(value - Z95 * deviation), float(value + Z95 * deviation))


def _change_entry(change: Change, series: ParameterSeries, vehicle: Vehicle) -> ChangeEntry:
    parameters, spread = series.parameters, series.variance[change.row]
    parameter, line = parameters[change.row], change.at(np.arange(len(spread)))
    moments = tuple(_shift_entry(shift) for shift in change.shifts)
    now = float(line[-1])
    is_back = len(moments) > 1 and abs(now) < Z95 * float(np.sqrt(spread[np.isfinite(spread)][-1]))
    rivals = [parameters[row] for row in change.rivals]
    return ChangeEntry(
        number=parameter.key,
        shifts=moments,
        now=now,
        line=tuple(line.tolist()),
        probability=change.probability,
        rivals=tuple(rival.key for rival in rivals),
        sentence=how_sure(change_sentence(parameter, moments, now, is_back, rivals), change.probability),
        advice=() if is_back or change.probability <= LIKELY else _advice(parameter, now, vehicle),
    )


def _shift_entry(shift: Shift) -> ShiftEntry:
    return ShiftEntry(
        "drift" if shift.is_drift else "step",
        shift.begin + 1,
        shift.low + 1,
        shift.high + 1,
        _deviation(shift.size, shift.deviation),
        shift.probability,
    )


def _alarm_entry(alarm: Alarm, parameters: Sequence[TrackedParameter]) -> AlarmEntry:
    parameter, rivals = parameters[alarm.row], [parameters[row] for row in alarm.rivals]
    text = f"{' or '.join(map(label_of, (parameter, *rivals)))} is not as before"
    return AlarmEntry(alarm.dive + 1, parameter.key, tuple(rival.key for rival in rivals), text)


def _advice(parameter: TrackedParameter, now: float, vehicle: Vehicle) -> tuple[str, ...]:
    """What to do about a parameter of the vehicle, where its effect has advice."""
    if parameter.effect == NOISE:
        return ()
    p = EFFECTS[parameter.effect].member_parameters(vehicle)[parameter.member]
    value = min(max(parameter.nominal + now, p.low), p.high)
    return tuple(advice.do for advice in EFFECTS[parameter.effect].advise(vehicle, {parameter.member: value}, {}))


def _cannot_tell(series: ParameterSeries) -> list[str]:
    pairs = list(zip(series.parameters, np.any(series.is_informed, axis=1).tolist(), strict=True))
    never = [label_of(parameter) for parameter, informed in pairs if not informed]
    rough = [label_of(parameter) for parameter, informed in pairs if parameter.is_rough and informed]
    found = [f"no dive tells {', '.join(never)}"] if never else []
    if rough:
        found.append(f"{', '.join(rough)}: shown, but not watched, because slopes do not tell what it does")
    return found


def label_of(parameter: TrackedParameter) -> str:
    """``thruster gain 3``, ``linear drag surge``, ``noise of x``."""
    if parameter.effect == NOISE:
        return f"noise of {parameter.member}"
    family, _, which = parameter.member.partition("_")
    own = which if which and family in ("gain", "scale", "angle", "drag") else parameter.member
    name = words(parameter.effect)
    return name if name.endswith(f" {own}") else f"{name} {words(own)}"


def size_of(deviation: float, unit: str) -> str:
    """A deviation with its sign: per cent where it has no unit."""
    sign = "+" if deviation > 0 else "−" if deviation < 0 else ""
    if unit == "1":
        share = 100 * abs(deviation)
        return f"{sign}{share:.{1 if share >= 1 else 2}f}\u202f%"
    return sign + quantity(abs(deviation), unit, 2)


def change_sentence(
    parameter: TrackedParameter,
    moments: Sequence[ShiftEntry],
    now: float,
    is_back: bool,
    rivals: Sequence[TrackedParameter],
) -> str:
    """What happened to one parameter, from the first moment to now; ``is_back`` where it is again as it was."""
    clauses = []
    for shift in moments:
        size = size_of(shift.size.value, parameter.unit)
        drifts = shift.kind == "drift"
        falls = f"{'falls' if shift.size.value < 0 else 'rises'} by {size.lstrip('+−')} a dive"
        clauses.append(f"from dive {shift.dive} on it {falls}" if drifts else f"{size} since dive {shift.dive}")
    text = f"{label_of(parameter)}: {', then '.join(clauses)}"
    if is_back:
        text += "; by now it is as it was"
    elif len(moments) > 1 or moments[0].kind == "drift":
        text += f"; {size_of(now, parameter.unit)} by now"
    if rivals:
        text += f" (or it is {' or '.join(label_of(rival) for rival in rivals[:MOST_NAMED])})"
    return text


def summary_of(
    changes: Sequence[ChangeEntry], labels: Mapping[str, str], alarms: Sequence[AlarmEntry], dives: Sequence[DiveEntry]
) -> str:
    """One sentence about all dives."""
    used = [dive for dive in dives if not dive.refused]
    if len(changes) == 1:
        return sentence(changes[0].sentence)
    if changes:
        each = [
            how_sure(f"{labels[change.number]} since dive {change.shifts[0].dive}", change.probability)
            for change in changes[:MOST_NAMED]
        ]
        more = [f"{len(changes) - MOST_NAMED} more"] if len(changes) > MOST_NAMED else []
        return f"{counted(len(changes), 'number')} changed: {', '.join([*each, *more])}."
    odd = [dive.number for dive in used if not dive.is_explained]
    which = f"{', '.join(map(str, odd[:MOST_NAMED]))}{', …' if len(odd) > MOST_NAMED else ''}"
    strange = f" Dive {which} shows something that is none of the numbers followed." if odd else ""
    if alarms:
        return f"There was an alarm at dive {alarms[0].dive}, and the dives since then do not bear it out.{strange}"
    return f"Nothing changed over {counted(len(used), 'dive')}.{strange}"


def console(history: DiveHistory) -> str:
    """The report as a few lines for the console."""
    used = [dive for dive in history.dives if not dive.refused]
    healthy = sum(dive.is_reference for dive in history.dives)
    first = "the first is" if healthy == 1 else f"the first {healthy} are"
    lines = [history.summary, "", f"{counted(len(used), 'dive')}, {first} the reference; {rate(history)}"]
    if history.changes:
        lines += ["", f"{'what changed':<40} {'since dive':>20} {'probability':>12}"]
    for change in history.changes:
        label, first = history.parameters[change.number].label, change.shifts[0]
        since = f"{first.dive} ({first.dive_low} to {first.dive_high})"
        lines.append(f"{label:<40} {since:>20} {percent(change.probability):>12}")
    if len(history.changes) > 1:
        lines += ["", *(sentence(change.sentence) for change in history.changes)]
    if history.alarms:
        lines += ["", *(f"alarm at dive {alarm.dive}: {alarm.sentence}" for alarm in history.alarms)]
    lines += [f"dive {dive.number} by itself: {dive.diagnosis.summary}" for dive in history.dives if dive.diagnosis]
    lines += [f"dive {d.number} ({d.name}) was not used: {d.refused}" for d in history.dives if d.refused]
    lines += [str(finding) for finding in history.findings if finding.code == BESIDES]
    advice = [do for change in history.changes for do in change.advice]
    return "\n".join([*lines, *(["", "what to do", *(f"  {sentence(do)}" for do in advice)] if advice else [])])


def rate(history: DiveHistory) -> str:
    """The rate of false alarms, in words."""
    return f"a sound vehicle raises one alarm in {history.dives_per_false_alarm:g} dives"
