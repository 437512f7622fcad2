"""The tables: who names the cause, who is near its size, who flies the vehicle best, and what none of them can say."""

from collections.abc import Callable, Iterable, Mapping, Sequence

from benchmarks.blind.flights.sizes import CLEAR
from benchmarks.blind.scores.table import Share, Table, median, number, quantile
from benchmarks.versus.judge import Outcome
from benchmarks.versus.labels import ALL, ASKED, FAMILIES, FIGURES, NOT_ASKED
from benchmarks.versus.own_simulator import LEFT_OUT
from benchmarks.versus.parameters import Free

OURS, MUJOCO, OWN = "diagnosis", "mujoco", "own_simulator"
COLUMNS = {OURS: "the diagnosis", MUJOCO: "mujoco.sysid, MuJoCo model", OWN: "mujoco.sysid, our simulator"}
Outcomes = Mapping[str, Sequence[Outcome]]  # by program


def causes(outcomes: Outcomes) -> Table:
    """How often the cause is named, by family."""
    groups = [*((family, (family,)) for family in ASKED), (ALL, ASKED)]
    rows = []
    for text, families in groups:
        own = [[o for o in outcomes[name] if o.family in families] for name in COLUMNS]
        if not own[0]:
            continue
        first = [Share.of(o.found for o in mine).fraction for mine in own]
        fits = zip(first[1:], (Share.of(o.found_unsure for o in mine).fraction for mine in own[1:]), strict=True)
        rows.append((text, first[0], *(f"{largest} ({surest})" for largest, surest in fits)))
    outside = [o.found for o in outcomes[OURS] if o.family == "outside"]
    rows.append((NOT_ASKED, str(Share.of(outside).fraction or "–"), "no such answer", "no such answer"))
    title = "The cause is the largest departure that its interval parts from nominal (in brackets: the largest of all)"
    return Table(title, ("family", *COLUMNS.values()), rows)


def figures(outcomes: Outcomes) -> Table:
    """Errors, sound numbers that moved, held-out flight and time."""
    measures: list[Callable[[Sequence[Outcome]], str]] = [
        lambda o: number(_errors(o), median, ".1%"),
        lambda o: number(_errors(o), lambda v: quantile(v, 0.9), ".1%"),
        lambda o: Share.of(c for one in o for c in one.covered).fraction or "–",
        lambda o: f"{median([one.moved for one in o]):g}",
        lambda o: str(max(one.moved for one in o)),
        lambda o: str(max(one.free for one in o) or "as many as are named"),
        lambda o: f"{median([one.before_m for one in o]):.3f}",
        lambda o: f"{median([one.after_m for one in o]):.3f}",
        lambda o: f"{quantile([one.after_m for one in o], 0.9):.3f}",
        lambda o: f"{median([one.cpu_s for one in o]):.1f}",
        lambda o: f"{max(one.cpu_s for one in o):.1f}",
    ]
    rows = [(text, *(of(outcomes[name]) for name in COLUMNS)) for text, of in zip(FIGURES, measures, strict=True)]
    return Table("Figures of all logs", ("", *COLUMNS.values()), rows)


def held_out(outcomes: Outcomes) -> Table:
    """Errors of held-out flight by family."""
    rows = []
    for family in FAMILIES:
        mine = [[o for o in outcomes[name] if o.family == family] for name in COLUMNS]
        if not mine[0]:
            continue
        cells = [f"{median([o.before_m for o in own]):.3f} → {median([o.after_m for o in own]):.3f}" for own in mine]
        rows.append((family, *cells))
    return Table("Held-out flight before → after, m at 2 s, medians", ("family", *COLUMNS.values()), rows)


def unsaid(mujoco: Iterable[Free], own: Iterable[Free]) -> Table:
    """For each effect of the logs, whether there is a number for it."""
    shown = [{cause for one in free for cause in one.causes} for free in (mujoco, own)]
    rows = []
    for effect in CLEAR:
        in_mujoco = "yes" if effect in shown[0] else "no"
        in_own = f"no: {LEFT_OUT[effect]}" if effect in LEFT_OUT and effect not in shown[1] else "yes"
        rows.append((effect, "yes", in_mujoco, in_own))
    return Table("Is there a number for the effect?", ("effect", *COLUMNS.values()), rows)


def by_case(outcomes: Outcomes) -> Table:
    """What each says of every log."""
    rows = []
    for together in zip(*(outcomes[name] for name in COLUMNS), strict=True):
        said = [f"{o.first}{'' if o.found is None else ' ✓' if o.found else ' ✗'}" for o in together]
        rows.append((together[0].case, together[0].family, together[0].truth, *said))
    return Table("What is said first", ("case", "family", "truth", *COLUMNS.values()), rows)


def tables(outcomes: Outcomes, mujoco: Iterable[Free], own: Iterable[Free]) -> list[Table]:
    """All of them, in the order in which they are read."""
    return [causes(outcomes), figures(outcomes), held_out(outcomes), unsaid(mujoco, own), by_case(outcomes)]


def _errors(outcomes: Iterable[Outcome]) -> list[float]:
    return [error for one in outcomes for error in one.errors]
