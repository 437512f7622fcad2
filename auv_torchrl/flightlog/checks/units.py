"""Units that the format asks for and logs often miss: seconds and commands in [-1, 1]."""

from collections.abc import Sequence

import numpy as np

from auv_torchrl.flightlog.findings import Finding, FlightLogError, Severity
from auv_torchrl.flightlog.log import Floats
from auv_torchrl.quantities import counted

SLOWEST_S = 2.0  # a log with a longer sampling interval shows no dynamics, and its t is probably not in seconds
COMMAND_LIMIT = 1.5  # rounding and mixing overshoot 1, other units exceed this
GLITCH_SHARE = 0.01


def check_commands(name: str, columns: Sequence[str], values: Floats, row: np.ndarray) -> list[Finding]:
    """Commands (T, k) outside [-1, 1]: glitches become NaN in place.

    Raises:
        FlightLogError: if the commands are in another unit.
    """
    findings = []
    size = np.abs(values)
    for i, column in enumerate(columns):
        beyond = np.flatnonzero(size[:, i] > COMMAND_LIMIT)
        if len(beyond) > GLITCH_SHARE * len(values):
            low, high = np.nanmin(values[:, i]), np.nanmax(values[:, i])
            remedy = (
                "(pulse - 1500) / 400" if high > 500 else "command / 100" if high > 10 else "command / full command"
            )
            raise FlightLogError(f"{name}: {column} lies in [{low:g}, {high:g}]: give commands in [-1, 1], as {remedy}")
        over = np.flatnonzero(size[:, i] > 1.0 + 1e-6)
        if len(beyond):
            code, where = "command_glitch", beyond
            sentence = f"{column} leaves [-1, 1] in {counted(len(beyond), 'row')}: left out"
            values[beyond, i] = np.nan
        elif len(over):
            code, where = "command_clipped", over
            sentence = f"{column} exceeds 1 by up to {np.nanmax(size[:, i]) - 1:.3f} and is clipped"
        else:
            continue
        rows = (int(row[where[0]]), int(row[where[-1]]))
        findings.append(Finding(Severity.WARNING, code, sentence, "Give commands in [-1, 1]", (column,), rows))
    return findings


def check_time_unit(name: str, t: Floats) -> None:
    """Refuse a log whose samples are seconds apart.

    Raises:
        FlightLogError: naming the likely unit.
    """
    steps = np.abs(np.diff(t[np.isfinite(t)]))  # backwards where the rows are reversed
    steps = steps[steps > 0]
    if len(steps) and (step := float(np.median(steps))) > SLOWEST_S:
        remedy = "t looks like milliseconds or microseconds: give seconds" if step >= 5 else "log at 2 Hz or faster"
        raise FlightLogError(f"{name}: samples are {step:g} s apart in t: {remedy}")
