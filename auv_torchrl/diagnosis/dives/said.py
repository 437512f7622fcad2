"""What changed, in words."""

from collections.abc import Mapping, Sequence

from auv_torchrl.diagnosis.dives.answer import AlarmTold, ChangeTold, DiveTold, ManyDives, ShiftTold
from auv_torchrl.diagnosis.dives.told import NOISE, Number
from auv_torchrl.diagnosis.logs import BESIDES
from auv_torchrl.diagnosis.report.wording import sentence
from auv_torchrl.diagnosis.verdict import how_sure
from auv_torchrl.quantities import counted, percent, quantity, words

_MOST_NAMED = 3


def label_of(number: Number) -> str:
    """``thruster gain 3``, ``linear drag surge``, ``noise of x``."""
    if number.effect == NOISE:
        return f"noise of {number.member}"
    family, _, which = number.member.partition("_")
    own = which if which and family in ("gain", "scale", "angle", "drag") else number.member
    name = words(number.effect)
    return name if name.endswith(f" {own}") else f"{name} {words(own)}"


def size_of(deviation: float, unit: str) -> str:
    """A deviation with its sign: per cent where it has no unit."""
    sign = "+" if deviation > 0 else "−" if deviation < 0 else ""
    if unit == "1":
        share = 100 * abs(deviation)
        return f"{sign}{share:.{1 if share >= 1 else 2}f}\u202f%"
    return sign + quantity(abs(deviation), unit, 2)


def change_sentence(
    number: Number, moments: Sequence[ShiftTold], now: float, is_back: bool, rivals: Sequence[Number]
) -> str:
    """What happened to one number, from the first moment to now; ``is_back`` where it is again as it was."""
    clauses = []
    for shift in moments:
        size = size_of(shift.size.value, number.unit)
        drifts = shift.kind == "drift"
        falls = f"{'falls' if shift.size.value < 0 else 'rises'} by {size.lstrip('+−')} a dive"
        clauses.append(f"from dive {shift.dive} on it {falls}" if drifts else f"{size} since dive {shift.dive}")
    said = f"{label_of(number)}: {', then '.join(clauses)}"
    if is_back:
        said += "; by now it is as it was"
    elif len(moments) > 1 or moments[0].kind == "drift":
        said += f"; {size_of(now, number.unit)} by now"
    if rivals:
        said += f" (or it is {' or '.join(label_of(rival) for rival in rivals[:_MOST_NAMED])})"
    return said


def summary_of(
    changes: Sequence[ChangeTold], labels: Mapping[str, str], alarms: Sequence[AlarmTold], dives: Sequence[DiveTold]
) -> str:
    """One sentence about all dives."""
    used = [dive for dive in dives if not dive.refused]
    if len(changes) == 1:
        return sentence(changes[0].sentence)
    if changes:
        each = [
            how_sure(f"{labels[change.number]} since dive {change.shifts[0].dive}", change.probability)
            for change in changes[:_MOST_NAMED]
        ]
        more = [f"{len(changes) - _MOST_NAMED} more"] if len(changes) > _MOST_NAMED else []
        return f"{counted(len(changes), 'number')} changed: {', '.join([*each, *more])}."
    odd = [dive.number for dive in used if not dive.is_explained]
    which = f"{', '.join(map(str, odd[:_MOST_NAMED]))}{', …' if len(odd) > _MOST_NAMED else ''}"
    strange = f" Dive {which} shows something that is none of the numbers followed." if odd else ""
    if alarms:
        return f"There was an alarm at dive {alarms[0].dive}, and the dives since then do not bear it out.{strange}"
    return f"Nothing changed over {counted(len(used), 'dive')}.{strange}"


def console(told: ManyDives) -> str:
    """The answer as a few lines for the console."""
    used = [dive for dive in told.dives if not dive.refused]
    sound = sum(dive.is_reference for dive in told.dives)
    first = "the first is" if sound == 1 else f"the first {sound} are"
    lines = [told.summary, "", f"{counted(len(used), 'dive')}, {first} the reference; {rate(told)}"]
    if told.changes:
        lines += ["", f"{'what changed':<40} {'since dive':>20} {'probability':>12}"]
    for change in told.changes:
        label, first = told.followed[change.number].label, change.shifts[0]
        since = f"{first.dive} ({first.dive_low} to {first.dive_high})"
        lines.append(f"{label:<40} {since:>20} {percent(change.probability):>12}")
    lines += ["", *(sentence(change.sentence) for change in told.changes)] if len(told.changes) > 1 else []
    lines += ["", *(f"alarm at dive {alarm.dive}: {alarm.sentence}" for alarm in told.alarms)] if told.alarms else []
    lines += [f"dive {dive.number} by itself: {dive.diagnosis.summary}" for dive in told.dives if dive.diagnosis]
    lines += [f"dive {dive.number} ({dive.name}) was not used: {dive.refused}" for dive in told.dives if dive.refused]
    lines += [str(finding) for finding in told.findings if finding.code == BESIDES]
    advice = [do for change in told.changes for do in change.advice]
    return "\n".join([*lines, *(["", "what to do", *(f"  {sentence(do)}" for do in advice)] if advice else [])])


def rate(told: ManyDives) -> str:
    """The rate of false alarms, in words."""
    return f"a sound vehicle raises one alarm in {told.dives_per_false_alarm:g} dives"
