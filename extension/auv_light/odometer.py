"""How much each thruster has worked in a dive, from the outputs of the autopilot.

``python -m auv_light.odometer DIVE [PARAMETERS]`` prints it as JSON. It runs in a process of its own: a log
may take much memory.
"""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from auv_torchrl.flightlog.findings import FlightLogError
from auv_torchrl.flightlog.readers import read_log
from auv_torchrl.flightlog.streams import ReadOptions, Streams, tabulate
from auv_torchrl.flightlog.streams.options import read_options

IDLE = 0.02  # of full command: less turns no propeller
_LONGEST_S = 1.0  # between two samples: longer is a pause of the log


def work(path: Path, options: ReadOptions | None = None) -> list[dict[str, float]]:
    """For each thruster: hours that it turned, hours at full thrust that this amounts to, and how often it started.

    Thrust goes with the square of the command. ``options`` have the parameters that a recording lacks.

    Raises:
        FlightLogError: for a log that cannot be read, or holds no commands.
    """
    options = options or ReadOptions()
    read = read_log(path, options)
    table = tabulate(read, options) if isinstance(read, Streams) else read
    numbered = (name for name in table.columns if name[:4] == "cmd_" and name[4:].isdigit())
    names = sorted(numbered, key=lambda name: int(name[4:]))
    if not names:
        raise FlightLogError(f"{path.name} holds no commands of thrusters: an odometer needs RCOU in the log")
    t = np.asarray(table.columns["t"], dtype=float)
    step = np.diff(t, append=t[-1:])
    step = np.where((step > 0) & (step <= _LONGEST_S), step, 0.0)
    return [_of(np.nan_to_num(np.asarray(table.columns[name], dtype=float)), step) for name in names]


def _of(command: Any, step: Any) -> dict[str, float]:
    turns = np.abs(command) > IDLE
    return {
        "hours": float(step[turns].sum() / 3600),
        "full_hours": float((step * command**2).sum() / 3600),
        "starts": int((turns[1:] & ~turns[:-1]).sum() + (turns[:1].sum())),
    }


def add(total: list[dict[str, float]], one: list[dict[str, float]]) -> list[dict[str, float]]:
    """The work of two dives together; a dive of a vehicle with more thrusters adds theirs."""
    longest = max(len(total), len(one))
    rows = [[dive[n] for dive in (total, one) if n < len(dive)] for n in range(longest)]
    return [{key: sum(row[key] for row in pair) for key in ("hours", "full_hours", "starts")} for pair in rows]


def main() -> None:
    """Print the work of a dive, or what is wrong with its log."""
    try:
        path, *given = sys.argv[1:]
        print(json.dumps({"thrusters": work(Path(path), read_options(params=given[0] if given else None))}))
    except FlightLogError as error:
        print(json.dumps({"error": str(error)}))


if __name__ == "__main__":
    main()
