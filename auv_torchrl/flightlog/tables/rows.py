"""Which rows of a log can be used, cut into uninterrupted stretches."""

import bisect
from typing import NamedTuple

import numpy as np

from auv_torchrl.flightlog.findings import Finding, Severity
from auv_torchrl.flightlog.log import Floats
from auv_torchrl.flightlog.tables.table import Table
from auv_torchrl.flightlog.tables.thinning import MOST_PARTS, mean_until_next, parts_until_next, rows_around, thinning
from auv_torchrl.physics import CONTROL_DT
from auv_torchrl.quantities import counted, percent

GAP_SAMPLES = 5  # a longer pause than this many usual sampling intervals ends a stretch,
GAP_S = 0.3  # if it is also longer than this
SHORTEST_S = 0.5  # stretches below this show nothing
SHORTEST_ROWS = 8
GLITCH_SHARE = 0.1  # up to this share of rows out of order are single glitches, more are a clock that was reset
SPARSE_SHARE = 0.5  # an axis that alone costs more than this share of the rows is left out

_WRAP = 3.0  # nothing else moves as far within one control step

Index = np.ndarray


class Stretch(NamedTuple):
    """Rows without interruption."""

    episode: int  # as in the file, 0 without that column
    t: Floats  # (T,) s since the start of the episode
    rows: Index  # (T,) rows of the table
    around: Index  # (T, w) rows to average each measurement over, w odd; the row itself where there are none
    commands: Floats  # (T, n) mean over the time until the next row
    parts: Floats | None  # (T, P, n) mean over P equal parts of that time; None where commands are held for all of it

    def mean(self, column: Floats, filled: np.ndarray | None = None) -> Floats:
        """A column of the table (T,), averaged around each row; not across the jump of a wrapped angle.

        Values that are ``filled`` in count where there is no other.
        """
        if self.around.shape[-1] == 1:
            return column[self.rows]
        window = column[self.around]
        jumps = window.max(axis=-1) - window.min(axis=-1) > _WRAP
        weight = np.ones(window.shape) if filled is None else 1.0 - filled[self.around]
        weight[weight.sum(axis=-1) == 0] = 1.0
        return np.where(jumps, column[self.rows], (weight * window).sum(axis=-1) / weight.sum(axis=-1))


def usable_axes(table: Table, axes: tuple[str, ...]) -> tuple[tuple[str, ...], list[Finding]]:
    """Those of the measured ``axes`` that are there in enough rows."""
    valid = {axis: np.isfinite(table.columns[axis]) for axis in axes}
    findings = []
    while valid:
        together = int(np.logical_and.reduce(list(valid.values())).sum())
        axis, here = min(valid.items(), key=lambda item: item[1].sum())
        most = max(int(v.sum()) for v in valid.values())
        if here.any() and together >= SPARSE_SHARE * most:
            break
        findings.append(
            Finding(
                Severity.WARNING,
                "sparse_axis",
                f"{axis} is left out: it is missing in {int((~here).sum())} of {counted(len(here), 'row')}",
                f"Log {axis} at every row or interpolate it before",
                columns=(axis,),
            )
        )
        del valid[axis]
    return tuple(valid), findings


def usable_stretches(
    table: Table, commanded: tuple[str, ...], axes: tuple[str, ...], commands: Floats, jumps: Index
) -> tuple[list[Stretch], list[Finding]]:
    """Cut the rows where time, commands and all ``axes`` are there into stretches with increasing time.

    They are cut before the rows ``jumps``, too.
    """
    findings = _missing(table, commanded, axes)
    seen = np.logical_and.reduce([np.isfinite(table.columns[axis]) for axis in axes])
    stretches = []
    for run in runs_of_time(table, np.asarray(np.isfinite(commands).all(axis=-1)), findings):
        stretches += _cut_at_gaps(table, run, seen, commands, int(table.episode[run[0]]), jumps, findings)
    return stretches, findings


def runs_of_time(table: Table, used: np.ndarray, findings: list[Finding]) -> list[Index]:
    """The rows that are ``used`` (T,) and have a time, in runs of one episode and strictly increasing time.

    What is wrong with the time is added to ``findings``.
    """
    t, number = table.columns["t"], table.episode
    usable = np.flatnonzero(np.isfinite(t) & np.isfinite(number) & used)
    if len(usable) > 1 and _runs_backwards(t[usable], number[usable]):
        rows = (int(table.row[usable[0]]), int(table.row[usable[-1]]))
        sentence = "time runs backwards through the whole file; its rows are taken in reverse order"
        remedy = "Sort the rows by t, rising; if t counts down, give the time since the start instead"
        findings.append(Finding(Severity.WARNING, "reversed_rows", sentence, remedy, ("t",), rows))
        usable = usable[::-1]
    episodes = np.split(usable, np.flatnonzero(np.diff(number[usable])) + 1)
    return [run for rows in episodes if len(rows) for run in _increasing_runs(table, t, rows, findings)]


def _runs_backwards(t: Floats, number: Floats) -> bool:
    """Whether all but single glitches of the rows are later than the next row of their episode."""
    steps = np.diff(t)[np.diff(number) == 0]
    return len(steps) > 0 and bool((steps < 0).mean() > 1 - GLITCH_SHARE)


def _increasing_runs(table: Table, t: Floats, rows: Index, findings: list[Finding]) -> list[Index]:
    """Rows of one episode in runs of strictly increasing time."""
    steps = np.diff(t[rows])
    wrong = np.flatnonzero(steps <= 0)
    if not len(wrong):
        return [rows]
    kept = rows[_longest_increasing(t[rows])]
    where = (int(table.row[rows[wrong[0] + 1]]), int(table.row[rows[wrong[-1] + 1]]))
    if len(kept) >= (1 - GLITCH_SHARE) * len(rows):
        sentence = f"time repeats or goes back; {counted(len(rows) - len(kept), 'row is', 'rows are')} left out"
        finding = Finding(
            Severity.WARNING, "time_not_increasing", sentence, "Write t in seconds, rising", ("t",), where
        )
        findings.append(finding)
        return [kept]
    repeats = float((steps == 0).mean())
    if repeats:  # few of them, too: what is cut where time goes back rises from row to row
        sentence = f"time repeats in {percent(repeats)} of the rows; the first row of each time is kept"
        remedy = "Write t with enough digits"
        findings.append(Finding(Severity.WARNING, "time_repeats", sentence, remedy, ("t",), where))
        rows = rows[np.concatenate(([True], steps != 0))]
    back = np.flatnonzero(np.diff(t[rows]) < 0) + 1
    if len(back):
        sentence = f"time goes back {counted(len(back), 'time')}; each start over is taken as a new episode"
        remedy = "Give an episode column"
        findings.append(Finding(Severity.WARNING, "time_starts_over", sentence, remedy, ("t",), where))
    return np.split(rows, back)


def _longest_increasing(values: Floats) -> Index:
    """Indices of a longest strictly increasing subsequence (patience sorting)."""
    tails: list[float] = []
    tail_index: list[int] = []
    before = np.full(len(values), -1)
    for i, value in enumerate(values.tolist()):
        k = bisect.bisect_left(tails, value)
        before[i] = tail_index[k - 1] if k else -1
        if k == len(tails):
            tails.append(value)
            tail_index.append(i)
        else:
            tails[k], tail_index[k] = value, i
    chain = []
    i = tail_index[-1]
    while i >= 0:
        chain.append(i)
        i = int(before[i])
    return np.array(chain[::-1])


def _cut_at_gaps(
    table: Table, run: Index, seen: np.ndarray, commands: Floats, episode: int, jumps: Index, findings: list[Finding],
) -> list[Stretch]:  # fmt: skip
    t = table.columns["t"]
    measured = np.flatnonzero(seen[run])
    if len(measured) < SHORTEST_ROWS:
        return _too_short(table, run, findings)
    steps = np.diff(t[run][measured])
    longest = max(GAP_SAMPLES * float(np.median(steps)), GAP_S)
    gaps = np.flatnonzero(steps > longest)
    for gap in gaps:
        rows = (int(table.row[run[measured[gap]]]), int(table.row[run[measured[gap + 1]]]))
        sentence = f"{steps[gap]:.2f} s without data; the log is cut there"
        findings.append(Finding(Severity.WARNING, "gap", sentence, "Log without pauses", ("t",), rows))
    rows_after = run[measured]
    jumps = np.searchsorted(rows_after, jumps[(jumps > rows_after[0]) & (jumps <= rows_after[-1])])
    cuts = np.union1d(gaps + 1, jumps)
    every = thinning(steps)
    if every > 1:
        sentence = f"sampled every {np.median(steps) * 1e3:.0f} ms; averaged to every {CONTROL_DT * 1e3:.0f} ms"
        findings.append(Finding(Severity.INFO, "thinned", sentence))
    stretches = []
    for part in np.split(measured, cuts):
        times = t[run[part]]
        if len(part) < SHORTEST_ROWS * every or times[-1] - times[0] < SHORTEST_S:
            _too_short(table, run[part], findings)
            continue
        kept = part[::every]
        acting = mean_until_next(t[run], commands[run], kept)
        parts = parts_until_next(t[run], commands[run], kept, min(every, MOST_PARTS))
        around = run[part[rows_around(len(part), every)]]
        stretches.append(Stretch(episode, t[run[kept]] - t[run[0]], run[kept], around, acting, parts))
    return stretches


def _too_short(table: Table, run: Index, findings: list[Finding]) -> list[Stretch]:
    rows = (int(table.row[run[0]]), int(table.row[run[-1]]))
    sentence = (
        f"a stretch of {counted(len(run), 'row')} is shorter than {SHORTEST_S} s or {SHORTEST_ROWS} rows and left out"
    )
    findings.append(Finding(Severity.WARNING, "short_stretch", sentence, "Log longer", ("t",), rows))
    return []


def _missing(table: Table, commanded: tuple[str, ...], axes: tuple[str, ...]) -> list[Finding]:
    names = ("t", *commanded, *axes, "episode")
    lacking = {name: ~np.isfinite(table.columns[name]) for name in names if name in table.columns}
    gone = table.row[np.logical_or.reduce(list(lacking.values()))]
    if not len(gone):
        return []
    named = tuple(name for name, lack in lacking.items() if lack.any())
    sentence = f"{counted(len(gone), 'row lacks', 'rows lack')} a number in {', '.join(named)}: left out"
    remedy = "Write a number in every row"
    return [Finding(Severity.WARNING, "missing_values", sentence, remedy, named, (int(gone[0]), int(gone[-1])))]
