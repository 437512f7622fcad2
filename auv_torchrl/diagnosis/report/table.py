"""The verdict as a few lines for the console."""

from collections.abc import Collection, Iterable

from auv_torchrl.diagnosis.report.charts import percent
from auv_torchrl.diagnosis.report.svg import between, estimated, number
from auv_torchrl.diagnosis.report.wording import diverged, measured_errors, sentence, to_do, words
from auv_torchrl.diagnosis.verdict import NO_MARK, Confirmation, Diagnosis, Gap, Verdict
from auv_torchrl.flightlog import Severity

_CANDIDATES = 3
_CELL = 26  # characters, the least width of a column of errors


def summary_table(diagnosis: Diagnosis, said: Collection[str] = ()) -> str:
    """Summary sentence, effects with their values, errors, what limits the answer, and what to do.

    ``said`` are the sentences of findings that were printed before.
    """
    begins = "" if diagnosis.verdict is Verdict.NO_GAP else f"{words(diagnosis.verdict.key)}: "
    lines = [f"{begins}{diagnosis.summary}"]
    if diagnosis.effects:
        lines += [
            "",
            f"{'effect':<22} {'prob.':>6}  {'parameter':<18} {'value':>9} {'95 % interval':>21} {'nominal':>9}  unit",
        ]
    for effect in diagnosis.effects:
        name, probability = effect.name, percent(effect.probability)
        for parameter, e in effect.parameters.items():
            value, inside = estimated(e.value, e.low, e.high), between(e.low, e.high)
            row = f"{name:<22} {probability:>6}  {parameter:<18} {value:>9} {inside:>21} {number(e.nominal):>9}"
            lines.append(f"{row}  {e.unit}".removesuffix("  1"))
            name = probability = ""
    if not diagnosis.effects and diagnosis.candidates:
        ranked = (f"{c.name} {percent(c.probability)}" for c in diagnosis.candidates[:_CANDIDATES])
        lines += ["", f"most probable: {', '.join(ranked)}"]
    lines += ["", *_errors(diagnosis)]
    limits = (line for line in diagnosis.cannot_tell if not line.endswith(NO_MARK))  # of those there are a dozen
    sections = {
        "what this rests on": _warnings(diagnosis, said),
        "what this log cannot tell": [sentence(line) for line in limits],
        "what to do": to_do(diagnosis),
    }
    for title, told in sections.items():
        if told:
            lines += ["", title, *(f"  {line}" for line in told)]
    return "\n".join(lines)


def _warnings(diagnosis: Diagnosis, said: Collection[str]) -> list[str]:
    """Warnings and errors, each once, but for parameters to set: "what to do" tells them."""
    matter = (f for f in diagnosis.findings if f.severity is not Severity.INFO and not f.param)
    return list(dict.fromkeys(str(f) for f in matter if f.sentence not in said))


def _errors(diagnosis: Diagnosis) -> list[str]:
    gap, confirmed = diagnosis.gap, diagnosis.gap.confirmed
    rows, flown = _rows(gap), _rows(confirmed) if confirmed else {}
    cells = (cell for row in (*rows.values(), *flown.values()) for cell in row)
    width = max(_CELL, 2 + max(map(len, cells), default=0))

    def line(name: str, row: Iterable[str]) -> str:
        return f"{name:<16}" + "".join(f"{cell:>{width}}" for cell in row)

    lines = [line("held-out error", (f"{h:g} s" for h in gap.horizon_s)), *(line(*row) for row in rows.items())]
    why_not = diverged(diagnosis) or "held-out flight shows none"
    closed = f"not defined, {why_not}" if gap.closed is None else percent(gap.closed)
    lines.append(f"before → after (floor); share of the gap closed: {closed}")
    if confirmed is not None:
        flown_lines = (line(*row) for row in flown.items())
        lines += ["", "the same flown in MuJoCo", *flown_lines, f"share closed there: {percent(confirmed.closed)}"]
    return lines


def _rows(gap: Gap | Confirmation) -> dict[str, list[str]]:
    """By kind, the errors before, after and floor at each horizon."""
    rows = {}
    for name, unit, errors in measured_errors(gap):
        triples = zip(errors.before, errors.after, errors.floor, strict=True)
        rows[f"{name}, {unit}"] = [f"{number(b, 2)} → {number(a, 2)} ({number(f, 2)})" for b, a, f in triples]
    return rows
