"""The process that reads logs: it takes folders, one a line, and writes into each what is in the log there.

It stands apart from the server so that a log which takes all memory, or breaks a library, ends this process alone. It
writes ``about.json``, which says what ``auv-log info`` says and what the page shows, and the curves of the overview.
"""

import json
import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from auv_torchrl.files import write_text
from auv_torchrl.flightlog.findings import Finding, FlightLogError
from auv_torchrl.flightlog.info import info_lines, table_lines
from auv_torchrl.flightlog.log import AXES, Floats
from auv_torchrl.flightlog.readers import read_log
from auv_torchrl.flightlog.readiness import begins
from auv_torchrl.flightlog.streams import ReadOptions, Streams, tabulate
from auv_torchrl.flightlog.tables.table import Table
from auv_torchrl.flightlog.understand import understand
from auv_torchrl.monitoring.dive_date import begun
from auv_torchrl.page import overview
from auv_torchrl.text import printable

ABOUT = "about.json"
_MOST_PARAMETERS = 5000  # of an autopilot; ArduSub has 1,100
_MOST_LINES = 400  # of what is said about a log
_MOST_MODES = 500


def recognise(folder: Path) -> dict[str, Any]:
    """Read the log of a folder, keep its curves there, and say what is in it; ``error`` says why it cannot be used."""
    (path,) = (folder / "upload").iterdir()
    try:
        read = read_log(path)
        return _of_table(read, path, folder) if isinstance(read, Table) else _of_streams(read, path, folder)
    except FlightLogError as error:
        return {"error": str(error)}
    except (MemoryError, RecursionError) as error:
        return {"error": f"the log takes more than this machine has ({type(error).__name__})"}


def _of_streams(streams: Streams, path: Path, folder: Path) -> dict[str, Any]:
    refused, table = "", None
    try:
        table = tabulate(streams, ReadOptions())
    except FlightLogError as error:
        refused = str(error)
    overview.write_panels(folder / overview.FILE, overview.panels_of_streams(streams, table))
    vehicle = streams.vehicle
    parameters = {name: value for name, value in vehicle.parameters.items() if math.isfinite(value)}
    battery = streams.streams.get("battery")
    return {
        "format": streams.format,
        "seconds": streams.end - streams.start,
        "begun": begun(path),
        "firmware": vehicle.firmware,
        "frame": vehicle.frame,
        "thrusters": vehicle.motors,
        "axes": [axis for axis in AXES if table is not None and axis in table.columns],
        "streams": list(streams.streams),
        "modes": [[begin, end, mode] for begin, end, mode in streams.mode_spans()[:_MOST_MODES]],
        "armed": list(streams.armed or ())[:_MOST_MODES],
        "battery": _range(battery.values[:, 0].tolist()) if battery is not None else None,
        "parameters": dict(list(parameters.items())[:_MOST_PARAMETERS]),
        "added": {} if table is None else {str(int(table.episode[0])): float(table.columns["t"][0])},
        "refused": refused,
        "findings": [_finding(finding, None, None) for finding in streams.findings],
        "lines": list(info_lines(streams))[1:_MOST_LINES],
    }


def _of_table(read: Table, path: Path, folder: Path) -> dict[str, Any]:
    understood = understand(read)
    table = understood.table
    if "t" not in table.columns:
        raise FlightLogError(f"{table.name} has no column of time: name it t, in s")
    refused, axes = "", []
    try:
        axes = list(begins(understood, path, None)[0])
    except FlightLogError as error:
        refused = str(error)
    t, added = overview.times_of(table)
    ordered, times = overview.in_time(table, t)
    overview.write_panels(folder / overview.FILE, overview.panels_of_table(ordered, times))
    commands = [name for name in table.columns if name.startswith("cmd_") and name[4:].isdigit()]
    return {
        "format": "table",
        "seconds": float(times[-1] - times[0]) if len(times) else 0.0,
        "begun": begun(path),
        "firmware": "",
        "frame": "",
        "thrusters": len(commands) or None,
        "axes": axes,
        "streams": list(table.columns),
        "modes": [],
        "armed": [],
        "battery": _range(table.columns["battery"].tolist()) if "battery" in table.columns else None,
        "parameters": dict(list(table.autopilot.items())[:_MOST_PARAMETERS]),
        "added": {str(number): value for number, value in added.items()},
        "refused": refused,
        "findings": [_finding(finding, table, t) for finding in table.findings],
        "lines": [line for line in table_lines(read, path) if "diagnose.py" not in line][1:_MOST_LINES],
    }


def _range(values: list[float]) -> list[float] | None:
    numbers = [value for value in values if math.isfinite(value)]
    return [min(numbers), max(numbers)] if numbers else None


def _finding(finding: Finding, table: Table | None, t: Floats | None) -> dict[str, Any]:
    span = None
    if finding.rows is not None and table is not None and t is not None and len(t):
        first, last = (min(int(np.searchsorted(table.row, row)), len(t) - 1) for row in finding.rows)
        span = [float(t[first]), float(t[last])]
    shown = {"severity": str(finding.severity), "sentence": finding.sentence, "remedy": finding.remedy}
    return {**shown, "where": finding.where, "span": span}


def _plain(about: Mapping[str, Any]) -> str:
    def finite(value: Any) -> Any:
        if isinstance(value, float):
            return value if math.isfinite(value) else None
        if isinstance(value, Mapping):
            return {str(key): finite(entry) for key, entry in value.items()}
        return [finite(entry) for entry in value] if isinstance(value, (list, tuple)) else value

    return json.dumps(finite(about), allow_nan=False)


def main() -> None:
    """Answer each folder with a line once its files are written; ends with the input."""
    for line in sys.stdin:
        folder = Path(line.rstrip("\n"))
        write_text(folder / ABOUT, printable(_plain(recognise(folder)), None))
        print("read", flush=True)


if __name__ == "__main__":
    main()
