"""The verdict as a few lines for the console."""

from collections.abc import Collection, Iterable

from auv_torchrl.diagnosis.report.wording import (
    diverged,
    likely_causes,
    measured_errors,
    next_best,
    rows,
    sentence,
    shown,
    to_do,
)
from auv_torchrl.diagnosis.unanswered.wording import is_all
from auv_torchrl.diagnosis.verdict import NOT_SHOWN, Confirmation, Diagnosis, Gap, Verdict
from auv_torchrl.flightlog import Severity
from auv_torchrl.quantities import number, percent, words

_ALTERNATIVES = 3


def summary_table(diagnosis: Diagnosis, printed: Collection[str] = ()) -> str:
    """Summary sentence, effects with their values, errors, what limits the answer, and what to do.

    ``printed`` are the sentences of findings that were printed before.
    """
    begins = "" if diagnosis.verdict is Verdict.NO_GAP else f"{words(diagnosis.verdict.key)}: "
    lines = [f"{begins}{diagnosis.headline or diagnosis.summary}"]
    if steps := to_do(diagnosis):
        lines += ["", "what to do", *(f"  {place}. {line}" for place, line in enumerate(steps, 1))]
    if diagnosis.headline and diagnosis.headline != diagnosis.summary:
        lines += ["", diagnosis.summary]
    if diagnosis.effects:
        lines += ["", f"{'effect, probability':<37} {'value':>10} {'95 % interval':>22} {'nominal':>8}"]
    faults = [effect for effect in diagnosis.effects if not effect.calibrates]
    corrections = [effect for effect in diagnosis.effects if effect.calibrates]
    for effect in (*faults, *(one for one in corrections if one.is_likely)):
        lines.append(f"{words(effect.name)}, {percent(effect.probability)}")
        for row in rows(effect):
            e = shown(row.estimate)
            name = f"{row.name}{e.unit and ', '}{e.unit}"
            lines.append(f"  {name:<35} {e.value:>10} {e.interval:>22} {e.nominal:>8}")
    unsure = [words(effect.name) for effect in corrections if not effect.is_likely]
    if unsure:
        lines.append(
            f"the vehicle's file, {percent(corrections[0].probability)}: {', '.join(unsure)} (values in report.html)"
        )
    if diagnosis.verdict not in (Verdict.EXPLAINED, Verdict.NO_GAP) and diagnosis.alternatives:
        causes = [f"{what} {percent(p)}" for what, p in likely_causes(diagnosis, _ALTERNATIVES).items()]
        lines += ["", f"one of these: {'; '.join(causes)}"] if len(causes) > 1 else []
    lines += ["", *_errors(diagnosis)]
    limits = (line for line in diagnosis.cannot_tell if not line.endswith(NOT_SHOWN))  # of those there are a dozen
    sections = {
        "what this rests on": _warnings(diagnosis, printed),
        "what this log cannot tell": [sentence(line) for line in limits],
    }
    for title, entries in sections.items():
        if entries:
            lines += ["", title, *(f"  {line}" for line in entries)]
    return "\n".join(lines)


def decision_table(diagnosis: Diagnosis) -> str:
    """How the verdict was reached: the explanations that were simulated, the runner-up, and why no other effect."""
    decision = diagnosis.decision
    lines = ["how this was decided", f"  {'explanation':<44} {'behind':>9} {'misfit':>8}  what became of it"]
    for one in decision.simulated:
        behind = "diverges" if one.log_evidence is None else number(decision.behind(one), 3)
        misfit = "–" if one.misfit is None else number(one.misfit, 3)
        lines.append(f"  {words(one.called):<44} {behind:>9} {misfit:>8}  {one.outcome.value}")
    lines += ["  behind: log units by which it is less probable than the one at 0"]
    lines += ["  misfit: chi-square per number, 1 is noise alone"]
    if decision.next_best:
        lines.append(f"  {next_best(decision)}")
    lines += ["", "why each effect is named, or is not"]
    width = max(map(len, decision.reasons), default=0)
    return "\n".join(lines + [f"  {words(name):<{width}}  {why}" for name, why in decision.reasons.items()])


def _warnings(diagnosis: Diagnosis, printed: Collection[str]) -> list[str]:
    """Warnings and errors, each once, but for parameters to set: "what to do" tells them."""
    matter = (f for f in diagnosis.findings if f.severity is not Severity.INFO and not f.param)
    return list(dict.fromkeys(str(f) for f in matter if f.sentence not in printed))


def _errors(diagnosis: Diagnosis) -> list[str]:
    gap, confirmed = diagnosis.gap, diagnosis.gap.confirmed
    lines = [_line("held-out error", "after", (f"{h:g} s" for h in gap.horizon_s)), *_rows(gap)]
    none = "the log does not show the vehicle" if is_all(diagnosis.findings) else "held-out flight shows none"
    why_not = diverged(diagnosis) or none
    closed = f"not defined, {why_not}" if gap.closed is None else percent(gap.closed)
    lines.append(f"share of the gap between before and floor that is closed: {closed}")
    if confirmed is not None:
        lines += ["", "the same flown in MuJoCo", *_rows(confirmed), f"share closed there: {percent(confirmed.closed)}"]
    return lines


def _rows(gap: Gap | Confirmation) -> list[str]:
    """Of each kind the errors before, after and floor at each horizon."""
    lines = []
    for name, unit, errors in measured_errors(gap):
        title = f"{name}, {unit}"
        for which in ("before", "after", "floor"):
            lines.append(_line(title, which, (number(value, 2) for value in getattr(errors, which))))
            title = ""
    return lines


def _line(title: str, which: str, cells: Iterable[str]) -> str:
    return f"{title:<16} {which:<8}" + "".join(f"{cell:>10}" for cell in cells)
