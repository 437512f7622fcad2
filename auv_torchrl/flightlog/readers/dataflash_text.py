"""ArduPilot's DataFlash log as text, ``.log``: the same messages, one a line, described by FMT lines."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from auv_torchrl.flightlog.findings import Finding, FlightLogError, Severity
from auv_torchrl.flightlog.readers.messages import AT, Messages, in_order

_TEXTS = ("Name", "Message")  # fields that are no number


def recognizes(head: bytes) -> bool:
    """Whether a file begins as such a log does."""
    return head.lstrip().startswith(b"FMT,") and b"Type,Length,Name,Format" in head


def read_messages(path: Path, wanted: Mapping[str, tuple[str, ...]]) -> Messages:
    """The lines of the types ``wanted``, with those of their fields that the log has; times ``t`` in s.

    Raises:
        FlightLogError: if there is no line of these types.
    """
    fields: dict[str, list[str]] = {}
    rows: dict[str, list[list]] = {}
    lost = lines = 0
    with path.open("r", encoding="utf-8", errors="replace") as file:
        for line in file:
            lines += 1
            name, _, rest = line.partition(",")
            name = name.strip()
            if name == "FMT":
                entry = [value.strip() for value in rest.split(",")]
                if len(entry) > 4:
                    fields[entry[2]] = entry[4:]
            elif name in wanted and name in fields:
                row = _row(rest, fields[name])
                if row is None:
                    lost += 1
                else:
                    rows.setdefault(name, []).append([lines, *row])
    if not rows:
        raise FlightLogError(f"{path.name} begins like an ArduPilot log and holds no line that can be read")
    types = {name: _columns(kept, fields[name], wanted[name]) for name, kept in rows.items()}
    findings = []
    if lost:
        sentence = f"{lost} of {lines} lines do not hold what their type has and are left out"
        findings.append(Finding(Severity.WARNING, "damaged_file", sentence, "Copy the file again"))
    return in_order(types, findings)


def _row(rest: str, names: list[str]) -> list | None:
    values = rest.split(",", len(names) - 1)
    if len(values) != len(names):
        return None
    try:
        return [v.strip() if n in _TEXTS else float(v) for n, v in zip(names, values, strict=True)]
    except ValueError:
        return None


def _columns(rows: list[list], names: list[str], wanted: tuple[str, ...]) -> dict[str, np.ndarray]:
    rows = [row for row in rows if len(row) == len(names) + 1]  # the type may have been described anew
    table = list(zip(*rows, strict=True))
    columns = {AT: np.array(table[0]) if table else np.zeros(0)}
    for name, values in zip(names, table[1:], strict=False):
        if name == "TimeUS":
            columns["t"] = np.array(values) * 1e-6
        elif name in wanted:
            columns[name] = np.array(values, dtype=str if name in _TEXTS else np.float64)
    return columns
