"""The verdict as a few lines for the console."""

from auv_torchrl.diagnosis.report.charts import percent
from auv_torchrl.diagnosis.report.svg import between, estimated, number
from auv_torchrl.diagnosis.report.wording import measured_errors, to_do
from auv_torchrl.diagnosis.verdict import Confirmation, Diagnosis, Gap

_CANDIDATES = 3


def summary_table(diagnosis: Diagnosis) -> str:
    """Summary sentence, effects with their values, errors before and after, and what to do."""
    lines = [f"{diagnosis.verdict.key.replace('_', ' ')}: {diagnosis.summary}"]
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
    if advice := to_do(diagnosis):
        lines += ["", "what to do", *(f"  {line}" for line in advice)]
    return "\n".join(lines)


def _errors(diagnosis: Diagnosis) -> list[str]:
    gap, confirmed = diagnosis.gap, diagnosis.gap.confirmed
    lines = [f"{'held-out error':<16}" + "".join(f"{f'{h:g} s':>26}" for h in gap.horizon_s), *_rows(gap)]
    closed = "not defined, held-out flight shows none" if gap.closed is None else percent(gap.closed)
    lines.append(f"before → after (floor); share of the gap closed: {closed}")
    if confirmed is not None:
        lines += ["", "the same flown in MuJoCo", *_rows(confirmed), f"share closed there: {percent(confirmed.closed)}"]
    return lines


def _rows(gap: Gap | Confirmation) -> list[str]:
    """Errors before, after and floor at each horizon, a line per kind."""
    lines = []
    for name, unit, errors in measured_errors(gap):
        triples = zip(errors.before, errors.after, errors.floor, strict=True)
        cells = (f"{number(b, 2)} → {number(a, 2)} ({number(f, 2)})" for b, a, f in triples)
        lines.append(f"{f'{name}, {unit}':<16}" + "".join(f"{cell:>26}" for cell in cells))
    return lines
