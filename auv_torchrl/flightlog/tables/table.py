"""A CSV or Parquet file as columns of float64, read block by block so that its text is never held at once."""

import json
import logging
import os
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from auv_torchrl.extras import library
from auv_torchrl.flightlog.findings import Finding, FlightLogError, Severity
from auv_torchrl.flightlog.log import AXES, Floats, SampleErrors
from auv_torchrl.flightlog.tables.cells import LARGEST, NUMBER, Odd, read_cells
from auv_torchrl.flightlog.tables.csv_rows import Rows, UnreadableRows
from auv_torchrl.flightlog.tables.header import first_bytes, read_header
from auv_torchrl.quantities import counted
from auv_torchrl.text import printable

log = logging.getLogger(__name__)

MAX_ROWS = 5_000_000  # 14 h at 100 Hz
MAX_NUMBERS = 20_000_000  # 14 h at 20 Hz of 20 columns; 160 MB as float64, and a diagnosis holds them several times
PARQUET = b"PAR1"
NOTE_KEY = b"auv-log"  # of the same in Parquet
MEASURED = "measured"  # column, 1 in rows in which something was measured
_BATCH_ROWS = 100_000  # from which reading is worth a word


@dataclass(frozen=True)
class Table:
    """Columns of one file, NaN where it holds no number, and ``row`` (T,): where each row was, from 1."""

    name: str
    columns: dict[str, Floats]
    row: np.ndarray
    findings: tuple[Finding, ...]
    units_known: bool = False  # the format of the file says in which units it is written
    measured: np.ndarray | None = None  # (T,) rows in which something was measured; None is all of them
    errors: SampleErrors = SampleErrors()
    autopilot: Mapping[str, float] = field(default_factory=dict)  # its parameters, where the file has them
    written: Mapping[str, str] = field(default_factory=dict)  # by column: as a number, a date or a clock

    @property
    def episode(self) -> Floats:
        """(T,) number of the episode of each row; 0 where the file does not say."""
        return self.columns.get("episode", np.zeros(len(self.row)))

    @property
    def note(self) -> str:
        """What the log of a vehicle says beside its columns, as JSON: how its samples err, and its parameters."""
        return json.dumps({**asdict(self.errors), "autopilot": dict(self.autopilot)})


def read_table(path: str | os.PathLike[str]) -> Table:
    """Read every column of a CSV or Parquet file.

    Raises:
        FlightLogError: if the file is missing, no regular file, empty, binary or neither of the two, or has no rows.
    """
    path = Path(path)
    name = printable(path.name)
    head = first_bytes(path, len(PARQUET))
    if not head:
        raise FlightLogError(f"{name} is empty: give a log that holds samples")
    try:
        table = _read_parquet(path) if head == PARQUET else _read_csv(path)
    except (UnreadableRows, OSError, UnicodeError) as error:
        raise unreadable(name, "Parquet" if head == PARQUET else "CSV", first_line(error)) from error
    if not len(table.row):
        raise FlightLogError(f"{name} has a header and no rows: give one row per sample")
    return table


def _read_parquet(path: Path) -> Table:
    library("pyarrow", f"Parquet ({printable(path.name)}) is read by", "logs", FlightLogError)
    from auv_torchrl.flightlog.tables.parquet import (
        read_parquet,  # here, not above: few logs are, and it need not be installed
    )

    return read_parquet(path)


def unreadable(name: str, kind: str, cause: str) -> FlightLogError:
    """The error of a file that is no table of a kind, for a cause."""
    return FlightLogError(
        f"{name} cannot be read as {kind} ({printable(cause)}): give a CSV file with a header line, comma between "
        "values, or a Parquet file"
    )


def _read_csv(path: Path) -> Table:
    if path.suffix.lower() in (".parquet", ".pq"):
        raise FlightLogError(f"{printable(path.name)} is not a Parquet file although it is named so: export it again")
    names, skipped, note = read_header(path)
    name = printable(path.name)
    table = Rows(path, skipped + 1, len(names))
    columns, written, odd = collect(name, names, table.blocks(), read_cells)
    bad_rows, rows = table.ragged, len(next(iter(columns.values()), ()))
    kept = np.setdiff1d(np.arange(1, rows + len(bad_rows) + 1), np.array(bad_rows))[:rows]
    findings = odd_findings(odd, kept)
    if bad_rows and not rows:
        raise FlightLogError(
            f"{name}: the header has {counted(len(names), 'column')} and none of the "
            f"{counted(len(bad_rows), 'row')} below it has as many values, the first has {table.lengths[0]}: give "
            "as many, with decimal points instead of decimal commas"
        )
    if bad_rows:
        findings.append(
            Finding(
                Severity.WARNING,
                "ragged_rows",
                f"{counted(len(bad_rows), 'row has', 'rows have')} not the {counted(len(names), 'value')} of the "
                "header: left out",
                "Check how the file was written or cut",
                rows=(min(bad_rows), max(bad_rows)),
            )
        )
    return as_noted(Table(name, columns, kept, tuple(findings), written=written), note)


def as_noted(table: Table, note: str) -> Table:
    """The table with what ``auv-log convert`` said of it; as it is where that is nothing."""
    if not note:
        return table
    try:
        content = json.loads(note)
        drift = {axis: _size(rate, axis) for axis, rate in content["drift"].items() if axis in AXES}
        errors = SampleErrors(_size(content["snapshot_s"], "snapshot_s"), drift)
        autopilot = {name: _float(value, name) for name, value in content["autopilot"].items()}
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise FlightLogError(
            f"{table.name}: what auv-log said of it is damaged ({printable(first_line(error))}): convert the log "
            "again, or remove the remark"
        ) from error
    columns = dict(table.columns)
    measured = columns.pop(MEASURED, None)
    as_written = {"units_known": True, "errors": errors, "autopilot": autopilot}
    return replace(table, columns=columns, measured=None if measured is None else measured > 0, **as_written)


def _float(value: object, name: str) -> float:
    """A number of a remark. JSON's whole numbers may have any number of digits."""
    if isinstance(value, bool) or not isinstance(value, int | float) or abs(value) > LARGEST:
        raise ValueError(f"{name} is no number that can be used")
    return float(value)


def _size(value: object, name: str) -> float:
    if not 0 <= (size := _float(value, name)) < np.inf:
        raise ValueError(f"{name} is {size:g}, which is no size")
    return size


def collect(
    name: str, names: Iterable[str], batches: Iterable[Sequence[Any]], read: Callable[..., tuple[Floats, str]]
) -> tuple[dict[str, Floats], dict[str, str], dict[str, Odd]]:
    """By column its values, how they are written, and its entries that are no number.

    Args:
        name: of the table.
        names: of its columns.
        batches: by column a block of entries.
        read: gives the values of such a block, as :func:`auv_torchrl.flightlog.tables.cells.read_cells` does.
    """
    shown = [column_name(column) for column in names]
    if repeated := sorted(column for column, times in Counter(shown).items() if times > 1):
        raise FlightLogError(f"{name} has the column {', '.join(repeated[:5])} more than once: keep one of each")
    blocks: dict[str, list[Floats]] = {column: [] for column in shown}
    written = {column: Counter[str]() for column in shown}
    odd = {column: Odd() for column in shown}
    rows = 0
    for batch in batches:
        count = len(batch[0]) if len(batch) else 0
        check_size(name, rows + count, len(shown))
        for column, block in zip(shown, batch, strict=True):
            values, how = read(block, odd[column], rows)
            blocks[column].append(values)
            written[column][how] += int(np.isfinite(values).sum())
        rows += count
        if rows >= _BATCH_ROWS:
            log.info("read %d rows of %s", rows, name)
    whole = {column: np.concatenate(blocks.pop(column) or [np.empty(0)]) for column in shown}
    how = {column: ways.most_common(1)[0][0] if ways else NUMBER for column, ways in written.items()}
    for column, ways in written.items():
        if sum(times > 0 for times in ways.values()) > 1:  # numbers and dates have no scale in common
            whole[column][:] = np.nan
            odd[column].count, odd[column].examples = rows, [f"{way}s" for way in ways if ways[way]]
            odd[column].first, odd[column].last = 0, rows - 1
    return whole, how, odd


def check_size(name: str, rows: int, columns: int) -> None:
    """Refuse a table that holds more than a diagnosis has memory for, before it is read.

    Raises:
        FlightLogError: naming the bound.
    """
    if rows > MAX_ROWS or rows * columns > MAX_NUMBERS:
        most = min(MAX_ROWS, MAX_NUMBERS // max(columns, 1))
        raise FlightLogError(
            f"{name} has more than {counted(most, 'row')} of {counted(columns, 'column')}: cut it, log at "
            "20 Hz, or leave out columns that are not needed"
        )


def column_name(found: object) -> str:
    """The name of a column as people are shown it, without blanks around it."""
    return printable(str(found).strip())


def odd_findings(odd: dict[str, Odd], row: np.ndarray) -> list[Finding]:
    """What to say of columns with entries that are no number."""
    return [
        Finding(
            Severity.WARNING,
            "not_a_number",
            f"{column} holds {counted(entries.count, 'entry that is', 'entries that are')} no "
            f"number, such as {', '.join(map(repr, entries.examples))}",
            "Write numbers with a decimal point",
            columns=(column,),
            rows=(int(row[entries.first]), int(row[entries.last])),
        )
        for column, entries in odd.items()
        if entries.count
    ]


def first_line(error: Exception) -> str:
    """What an error says, on one line."""
    return (str(error).strip() or type(error).__name__).splitlines()[0]
