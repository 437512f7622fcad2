"""Whether the values of a column carry information: a sensor that stands still, repeats, leaps or rounds does not.

A measured value is never the same twice unless it was written coarsely, and a vehicle does not leap from one sample to
the next. What breaks these two rules is no measurement: it is left out (its place is filled in, without weight in the
diagnosis), and a finding says which share and which rows.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from auv_torchrl.flightlog.checks.leaps import find_leaps
from auv_torchrl.flightlog.findings import Finding, FlightLogError, Severity
from auv_torchrl.flightlog.log import ANGLES, Floats
from auv_torchrl.flightlog.signals import runs
from auv_torchrl.flightlog.tables.table import Table
from auv_torchrl.quantities import counted, percent

FROZEN_S = 1.0  # s without any change, from which a sensor with noise stands still,
FROZEN_COARSE_S = 8.0  # and one whose writing rounds away small motions, at least this many times its usual pauses:
PAUSES = 8.0
HOLDS = 4.0  # times the usual time for which a slow sensor is held
ACTIVE = 0.1  # command from which a thruster may push; a vehicle that nothing pushes may stand still
REPEATED = 0.01  # share of the rows from which repeats are worth a word
COARSE = 0.4  # step of writing, in typical changes of a column, from which small motions are lost
BY_CHANCE = 0.3  # share of the repeats that rounding accounts for, from which nothing was held
LEAST_SEEN = 0.15  # share of the values without which an axis is left out


@dataclass(frozen=True)
class Checked:
    """Measured columns whose doubtful values are filled in."""

    columns: dict[str, Floats]  # (T,) each, by axis; doubtful values interpolated
    filled: dict[str, np.ndarray]  # (T,) True where a value is filled in
    resolution: dict[str, float]  # step in which an axis was written; 0 where it is finer than can be told
    cuts: np.ndarray  # rows (indices) before which a sensor jumped for good
    findings: tuple[Finding, ...]


class _Axis(NamedTuple):
    """What one column shows; masks (T,)."""

    constant: bool
    resolution: float
    coarse: bool
    frozen: np.ndarray
    held: np.ndarray
    outlier: np.ndarray
    jumps: np.ndarray  # indices of the first row behind each


def check_information(table: Table, axes: tuple[str, ...], commands: Floats) -> Checked:
    """Look at every measured column by itself, beside the commands (T, n) of the thrusters.

    Raises:
        FlightLogError: if no column ever changes.
    """
    t, episode, measured = table.columns["t"], table.episode, {axis: table.columns[axis] for axis in axes}
    active = np.abs(np.nan_to_num(commands)).max(axis=-1, initial=0.0) > ACTIVE
    seen = {name: _look_at(name, t, episode, values, active) for name, values in measured.items()}
    if seen and all(axis.constant for axis in seen.values()):
        names = ", ".join(seen)
        raise FlightLogError(
            f"nothing that was measured ever changes ({names}): the sensors were frozen or not connected; "
            "give a log in which the vehicle moves"
        )
    findings = _findings(seen, t, table.row)
    columns, filled = {}, {}
    for name, axis in seen.items():
        doubt = axis.frozen | axis.held | axis.outlier
        there = np.isfinite(measured[name]) & ~doubt
        if axis.constant or there.sum() < LEAST_SEEN * len(t):
            continue
        columns[name], filled[name] = _filled_in(name, t, episode, measured[name], doubt), doubt
    kept = {name: axis for name, axis in seen.items() if name in columns}
    cuts = np.unique(np.concatenate([np.empty(0, int), *(axis.jumps for axis in kept.values())]))
    resolution = {name: axis.resolution for name, axis in kept.items()}
    return Checked(columns, filled, resolution, cuts, tuple(findings))


def _look_at(name: str, t: Floats, episode: Floats, values: Floats, active: np.ndarray) -> _Axis:
    here = np.flatnonzero(np.isfinite(values) & np.isfinite(t))
    nowhere, none = np.zeros(len(values), bool), np.empty(0, int)
    v = values[here]
    if not len(v) or v.min() == v.max():
        return _Axis(bool(len(v)), 0.0, False, nowhere, nowhere, nowhere, none)
    step = _resolution(v)
    joined = (np.diff(episode[here]) == 0) & (np.diff(t[here]) > 0)
    change = np.where(joined, np.diff(v), np.nan)
    rounded, coarse = _by_rounding(change, step)
    repeats = np.concatenate([[False], change == 0])
    frozen = _frozen(t[here], repeats, active[here], rounded)
    held = repeats & ~frozen & (not rounded)
    fresh = np.flatnonzero(~(frozen | held))
    stretch = np.concatenate([[0], np.cumsum(~joined)])
    outlier, jumps = find_leaps(name, t[here][fresh], v[fresh], stretch[fresh], step)

    def among_all(some: np.ndarray) -> np.ndarray:
        mask = nowhere.copy()
        mask[here[some]] = True
        return mask

    return _Axis(False, step, coarse, among_all(frozen), among_all(held), among_all(fresh[outlier]), here[fresh[jumps]])


def _resolution(v: Floats) -> float:
    """The step of which all values are multiples; 0 where there is none."""
    levels = np.unique(v)
    apart = np.diff(levels)
    apart = apart[apart > 1e-12 * max(1.0, float(np.abs(levels).max()))]
    if not len(apart):
        return 0.0
    step = float(apart.min())
    counts = (levels - levels[0]) / step
    return step if (np.abs(counts - np.round(counts)) < 0.02).mean() > 0.99 else 0.0


def _by_rounding(change: Floats, step: float) -> tuple[bool, bool]:
    """Whether rounding makes a column repeat as often as it does, and whether small motions are lost by it."""
    moved = np.abs(change[np.isfinite(change)])
    if not step or not moved.any():
        return False, False
    repeats, moved = (moved == 0).mean(), moved[moved > 0]
    by_one = (moved < 1.5 * step).mean() * (1 - repeats)  # as often as a change rounds to one step, up or down,
    rounded = bool(by_one / 2 > BY_CHANCE * repeats or np.median(moved) <= 1.5 * step)  # half as often to none
    return rounded, rounded and bool(repeats > REPEATED and step > COARSE * np.median(moved))


def _frozen(t: Floats, repeats: np.ndarray, active: np.ndarray, rounded: bool) -> np.ndarray:
    """(T,) True from the first repeat on in stretches without change that no resting vehicle or rounding makes."""
    begin, behind = runs(repeats).T  # the first repeat of each run, and what follows the last one
    frozen = np.zeros(len(t), bool)
    if not len(begin):
        return frozen
    lasting = t[behind - 1] - t[begin - 1]
    usual = lasting[lasting < FROZEN_S]
    if rounded:
        least = max(FROZEN_COARSE_S, PAUSES * float(np.quantile(lasting, 0.95)) if len(lasting) > 20 else 0.0)
    else:
        least = max(FROZEN_S, HOLDS * float(np.median(usual)) if len(usual) else 0.0)
    for first, end in zip(begin[lasting >= least], behind[lasting >= least], strict=True):
        frozen[first:end] = active[first:end].any()
    return frozen


def _filled_in(name: str, t: Floats, episode: Floats, values: Floats, doubt: np.ndarray) -> Floats:
    """The column with doubtful values interpolated within their episode."""
    filled = values.copy()
    for number in np.unique(episode[doubt]):
        inside = episode == number
        good = np.flatnonzero(inside & ~doubt & np.isfinite(values) & np.isfinite(t))
        bad = np.flatnonzero(inside & doubt)
        if len(good):
            series = np.unwrap(values[good]) if name in ANGLES else values[good]
            filled[bad] = np.interp(t[bad], t[good], series)
    if name in ANGLES:
        filled[doubt] = np.remainder(filled[doubt] + np.pi, 2 * np.pi) - np.pi
    return filled


def _findings(seen: Mapping[str, _Axis], t: Floats, row: np.ndarray) -> list[Finding]:
    found = []
    if still := tuple(name for name, axis in seen.items() if axis.constant):
        verb = "never changes: it is" if len(still) == 1 else "never change: they are"
        sentence = f"{', '.join(still)} {verb} not used, and what it would show cannot be told"
        found.append(_finding("constant_column", sentence, "Check that the sensor was connected and logged", still))
    for names, mask in _by_axes(seen, "frozen"):
        for first, behind in runs(mask):
            seconds = t[behind - 1] - t[first]
            verb = "stands" if len(names) == 1 else "stand"
            sentence = (
                f"{', '.join(names)} {verb} still for {seconds:.1f} s while the vehicle is driven; left out there"
            )
            rows = (int(row[first]), int(row[behind - 1]))
            found.append(_finding("frozen", sentence, "Check the sensor and its cable", names, rows))
    for kind, code, what, remedy in _KINDS:
        for names, mask in _by_axes(seen, kind):
            share = float(mask.mean())
            if kind == "held" and share < REPEATED:
                continue
            where = np.flatnonzero(mask)
            size = f"{percent(share)} of the rows" if share >= REPEATED else counted(len(where), "row")
            sentence = what.format(names=", ".join(names), size=size)
            found.append(_finding(code, sentence, remedy, names, (int(row[where[0]]), int(row[where[-1]]))))
    for name, axis in seen.items():
        for k in axis.jumps:
            sentence = f"{name} jumps from one row to the next and goes on from there; the log is cut there"
            found.append(_finding("jump", sentence, "Check the sensor", (name,), (int(row[k - 1]), int(row[k]))))
    if coarse := tuple(name for name, axis in seen.items() if axis.coarse and not axis.constant):
        steps = ", ".join(f"{name} in steps of {seen[name].resolution:.2g}" for name in coarse)
        sentence = f"values are written coarsely: {steps}; smaller motions cannot be seen"
        found.append(_finding("coarse", sentence, "Write more digits", coarse))
    return found


_KINDS = (
    ("held", "held_samples", "values of {names} repeat the one before in {size}: a slower sensor, or samples that got "
     "lost; repeats are not used", "Log each measurement once, when it was taken"),
    ("outlier", "outliers", "values of {names} lie far off the path in {size}; they are left out", "Check the sensor"),
)  # fmt: skip


def _finding(
    code: str, sentence: str, remedy: str, names: Sequence[str], rows: tuple[int, int] | None = None
) -> Finding:
    return Finding(Severity.WARNING, code, sentence, remedy, tuple(names), rows)


def _by_axes(seen: Mapping[str, _Axis], kind: str) -> list[tuple[tuple[str, ...], np.ndarray]]:
    """Axes with nearly the same rows of a kind, together, and the rows of the first of them."""
    groups: list[tuple[list[str], np.ndarray]] = []
    for name, axis in seen.items():
        mask = getattr(axis, kind)
        if not mask.any():
            continue
        for names, known in groups:
            if (mask & known).sum() > 0.8 * max(mask.sum(), known.sum()):
                names.append(name)
                break
        else:
            groups.append(([name], mask))
    return [(tuple(names), mask) for names, mask in groups]
