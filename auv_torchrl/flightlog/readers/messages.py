"""Messages of a log by type, as columns, and a clock that was reset put in order."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from auv_torchrl.flightlog.findings import Finding, Severity

Columns = Mapping[str, np.ndarray]  # by field; all of one length
AT = "at"  # the column that says where in the file a message was: a byte, a line or a number
_JUMP_S = 1.0  # messages are written up to some tenths of a second late; what steps back further is another clock
_NEIGHBOURS = 5  # whose median a time must agree with


@dataclass(frozen=True)
class Messages:
    """What was read, times in seconds under ``t``."""

    types: Mapping[str, Columns]
    findings: tuple[Finding, ...] = ()

    def __contains__(self, name: str) -> bool:
        return name in self.types

    def get(self, name: str, *fields: str) -> Columns | None:
        """The messages of a type; None if there are none or they lack one of the fields."""
        found = self.types.get(name)
        return found if found is not None and all(field in found for field in ("t", *fields)) else None


def in_order(types: dict[str, dict[str, np.ndarray]]) -> Messages:
    """Times ``t`` that start at 0 and never go back; each start over is put a second behind what was before.

    A message whose time agrees with none of its neighbours in the file is left out.
    """
    timed = {name: columns for name, columns in types.items() if "t" in columns}
    if not timed:
        return Messages(types)
    at = np.concatenate([columns[AT] for columns in timed.values()])
    order = np.argsort(at, kind="stable")
    t = np.concatenate([columns["t"] for columns in timed.values()])[order]
    usual = _running_median(t)
    odd = ~(np.abs(t - usual) <= _JUMP_S)
    back = np.flatnonzero(np.diff(usual) < -_JUMP_S) + 1
    shift = np.zeros(len(t))
    for i in back:
        shift[i:] += usual[i - 1] - usual[i] + _JUMP_S
    first = t[~odd].min() if (~odd).any() else 0.0
    place = np.empty(len(t), np.intp)
    place[order] = np.arange(len(t))
    kept: dict[str, Columns] = {name: columns for name, columns in types.items() if name not in timed}
    begin = 0
    for name, columns in timed.items():
        mine = place[begin : begin + len(columns["t"])]
        begin += len(mine)
        moved = {**columns, "t": columns["t"] + shift[mine] - first}
        good = ~odd[mine]
        kept[name] = moved if good.all() else {field: values[good] for field, values in moved.items()}
    findings = []
    if len(back):
        sentence = f"the clock of the log starts over {len(back)} times; each start is read as a second after the rest"
        findings.append(Finding(Severity.WARNING, "clock_reset", sentence, "Give logs of one start each"))
    if odd.any():
        sentence = f"{int(odd.sum())} messages bear a time that none of their neighbours has and are left out"
        findings.append(Finding(Severity.WARNING, "odd_times", sentence))
    return Messages(kept, tuple(findings))


def _running_median(t: np.ndarray) -> np.ndarray:
    if len(t) < _NEIGHBOURS:
        return t
    half = _NEIGHBOURS // 2
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(t, half, mode="reflect"), _NEIGHBOURS)
    parts = np.array_split(windows, 1 + (len(t) >> 20))  # each is copied
    return np.concatenate([np.partition(part, half, axis=-1)[:, half] for part in parts])
