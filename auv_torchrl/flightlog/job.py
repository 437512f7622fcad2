"""What ``auv-log`` does once its command line is read."""

import re
import sys
import textwrap
from pathlib import Path

from auv_torchrl.flightlog.findings import FlightLogError
from auv_torchrl.flightlog.info import info_lines, table_lines
from auv_torchrl.flightlog.readers import TABLES, read_log, read_streams
from auv_torchrl.flightlog.streams import ReadOptions, tabulate
from auv_torchrl.flightlog.streams.parameters import NOT_FINITE
from auv_torchrl.flightlog.tables.table import Table
from auv_torchrl.flightlog.understand import understand
from auv_torchrl.flightlog.writer import write_table
from auv_torchrl.quantities import counted
from auv_torchrl.text import printable
from auv_torchrl.vehicle import Vehicle, load_vehicle

WIDTH = 80  # letters of a row on a terminal
_DEEPEST = 45  # letters that a row is indented at most
_INDENT = 2
_COMMAND = "python diagnose.py"  # of a line that is copied


def info(files: list[Path], options: ReadOptions, healthy: str = "", vehicle: str = "") -> None:
    """Print what is in each log, its parameters compared with those of a ``healthy`` one.

    A table is read as a diagnosis of this ``vehicle`` reads it, where one is named.

    Raises:
        FlightLogError: at the end, for those that cannot be read.
    """
    sound = read_streams(Path(healthy), options) if healthy else None
    parameters = sound.vehicle.parameters if sound else None
    if healthy and not parameters:
        raise FlightLogError(f"healthy={healthy} holds no parameters of an autopilot: give the log of a sound flight")
    odd = [finding for finding in sound.findings if finding.code == NOT_FINITE] if sound else []
    flown = _vehicle(vehicle) if vehicle else None
    failed = []
    for file in files:
        try:
            log = read_log(file, options)
            if isinstance(log, Table):
                lines = table_lines(log, file, flown, vehicle or "...")
            else:
                lines = info_lines(log, options, parameters)
            print("\n".join(fitted(line) for line in (*lines, *(f"  {finding}" for finding in odd))))
        except FlightLogError as error:
            failed.append(str(error))
    if failed:
        raise FlightLogError("; ".join(failed))


def _vehicle(name: str) -> Vehicle:
    try:
        return load_vehicle(name)
    except (FileNotFoundError, ValueError) as error:
        raise FlightLogError(str(error)) from error


def fitted(line: str) -> str:
    """A line in rows of 80 letters: what is behind its first word goes on below it, commands stay whole."""
    if len(line) <= WIDTH or _COMMAND in line:
        return line
    head = re.match(r" *(\S+( \S+)* {2,})*", line)
    indent = min(head.end() if head else 0, _DEEPEST) or _INDENT
    blanks = len(line) - len(line.lstrip())
    first, rest = " " * blanks, " " * max(indent, blanks + _INDENT if head and head.end() == blanks else 0)
    return textwrap.fill(
        line[blanks:], WIDTH, initial_indent=first, subsequent_indent=rest, break_long_words=False,
        break_on_hyphens=False,
    )  # fmt: skip


def convert(files: list[Path], options: ReadOptions, keys: dict[str, str]) -> None:
    """Write one table of a log.

    Raises:
        FlightLogError: for a log or an output that cannot be.
        FileExistsError: for an output that is there, unless it may be replaced.
    """
    if len(files) > 1:
        raise FlightLogError(f"convert takes one log, these are {len(files)}: convert them one by one")
    output = Path(keys.get("output", ""))
    if output.suffix.lower() not in TABLES:
        raise FlightLogError(
            f"output={keys.get('output', '')} says no format: give output=log.csv or output=log.parquet"
        )
    if not output.absolute().parent.is_dir():
        raise FlightLogError(f"there is no folder {output.parent}: make it, or write elsewhere")
    replace = keys.get("replace", "").lower() == "true"
    if output.exists() and not replace:
        raise FileExistsError(f"{output} exists: choose another name, or give replace=true")
    log = read_log(files[0], options)
    table = understand(log).table if isinstance(log, Table) else tabulate(log, options)
    for finding in table.findings:
        print(finding, file=sys.stderr)
    write_table(table, output, replace)
    print(f"{printable(str(output), None)}: {counted(len(table.row), 'row')} of {' '.join(table.columns)}")
