"""A CSV or Parquet file as columns of float64, read block by block so that its text is never held at once."""

import json
import logging
import os
from array import array
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.csv

from auv_torchrl.flightlog.cells import LARGEST, NUMBER, Odd, is_flat, read_cells
from auv_torchrl.flightlog.findings import Finding, FlightLogError, Severity
from auv_torchrl.flightlog.header import MOST_COLUMNS, check_number, first_bytes, read_header
from auv_torchrl.flightlog.log import AXES, Floats, SampleErrors
from auv_torchrl.quantities import counted
from auv_torchrl.text import printable

log = logging.getLogger(__name__)

MAX_ROWS = 5_000_000  # 14 h at 100 Hz
MAX_NUMBERS = 20_000_000  # 14 h at 20 Hz of 20 columns; 160 MB as float64, and a diagnosis holds them several times
_PARQUET = b"PAR1"
SAID_KEY = b"auv-log"  # of the same in Parquet
MEASURED = "measured"  # column, 1 in rows in which something was measured
_BLOCK_BYTES = 8 << 20
_BATCH_ROWS = 100_000  # from which reading is worth a word
_BATCH_NUMBERS = 1_000_000  # of all columns together that Parquet is unpacked to at a time
_LONGEST_FOOTER = 8 << 20  # bytes; of 1,000 columns in 20 row groups it takes 2 MB
_LARGEST_CHUNK = 128 << 20  # bytes; a column of MAX_ROWS numbers takes 40 MB
_MOST_RAGGED = 1_000_000  # rows with too many or too few values: such a file is no table


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
    def said(self) -> str:
        """What the log of a vehicle says beside its columns, as JSON: how its samples err, and its parameters."""
        return json.dumps({**asdict(self.errors), "autopilot": dict(self.autopilot)})


def read_table(path: str | os.PathLike[str]) -> Table:
    """Read every column of a CSV or Parquet file.

    Raises:
        FlightLogError: if the file is missing, no regular file, empty, binary or neither of the two, or has no rows.
    """
    path = Path(path)
    name = printable(path.name)
    head = first_bytes(path, len(_PARQUET))
    if not head:
        raise FlightLogError(f"{name} is empty: give a log that holds samples")
    try:
        table = _read_parquet(path) if head == _PARQUET else _read_csv(path)
    except (pa.ArrowException, OSError, UnicodeError) as error:
        kind = "Parquet" if head == _PARQUET else "CSV"
        raise FlightLogError(
            f"{name} cannot be read as {kind} ({_cause(error)}): give a CSV file with a header line, "
            "comma between values, or a Parquet file"
        ) from error
    if not len(table.row):
        raise FlightLogError(f"{name} has a header and no rows: give one row per sample")
    return table


def _read_csv(path: Path) -> Table:
    if path.suffix.lower() in (".parquet", ".pq"):
        raise FlightLogError(f"{printable(path.name)} is not a Parquet file although it is named so: export it again")
    names, skipped, said = read_header(path)
    name = printable(path.name)
    bad_rows = array("q")
    lengths = array("q")

    def remember(row: pyarrow.csv.InvalidRow) -> str:
        above = skipped + 1  # lines that arrow counts: those skipped and the header
        bad_rows.append(-1 if row.number is None else row.number - above)
        lengths.append(row.actual_columns)
        return "skip" if len(bad_rows) < _MOST_RAGGED else "error"

    with _opened(path) as file:
        reader = pyarrow.csv.open_csv(
            file,
            read_options=pyarrow.csv.ReadOptions(
                use_threads=False, block_size=_BLOCK_BYTES, skip_rows=skipped + 1, column_names=names
            ),
            parse_options=pyarrow.csv.ParseOptions(invalid_row_handler=remember),
            convert_options=pyarrow.csv.ConvertOptions(
                column_types=dict.fromkeys(names, pa.string()), strings_can_be_null=True
            ),
        )
        columns, written, odd = _collect(name, names, iter(reader))
    rows = len(next(iter(columns.values()), ()))
    kept = np.setdiff1d(np.arange(1, rows + len(bad_rows) + 1), np.array(bad_rows))[:rows]
    findings = _odd_findings(odd, kept)
    if bad_rows and not rows:
        raise FlightLogError(
            f"{name}: the header has {counted(len(names), 'column')} and none of the "
            f"{counted(len(bad_rows), 'row')} below it has as many values, the first has {lengths[0]}: give "
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
    return _as_said(Table(name, columns, kept, tuple(findings), written=written), said)


def _read_parquet(path: Path) -> Table:
    from pyarrow.parquet import ParquetFile  # here, not above: few logs are

    name = printable(path.name)
    with path.open("rb") as file:
        _check_footer(name, file)
    with _opened(path) as opened:
        with ParquetFile(opened) as file:
            flat = [field.name for field in file.schema_arrow if is_flat(field.type)]
            nested = [column_name(f.name) for f in file.schema_arrow if not is_flat(f.type)]
            check_number(name, len(file.schema_arrow.names))
            check_size(name, file.metadata.num_rows, len(flat))
            _check_chunks(name, file.metadata)
            text = [f.name for f in file.schema_arrow if pa.types.is_string(f.type) or pa.types.is_large_string(f.type)]
            said = (file.schema_arrow.metadata or {}).get(SAID_KEY, b"").decode()
        opened.seek(0)
        with ParquetFile(opened, read_dictionary=text) as file:  # a long text that repeats is held once
            batches = file.iter_batches(max(1, _BATCH_NUMBERS // max(len(flat), 1)), columns=flat)
            columns, written, odd = _collect(name, flat, batches)
    row = np.arange(1, len(next(iter(columns.values()), ())) + 1)
    findings = _odd_findings(odd, row)
    if nested:
        sentence = f"{', '.join(nested[:5])}{' and others' if len(nested) > 5 else ''} hold no single numbers: left out"
        remedy = "Write one number per row and column"
        findings.append(Finding(Severity.WARNING, "nested_columns", sentence, remedy, tuple(nested[:5])))
    return _as_said(Table(name, columns, row, tuple(findings), written=written), said)


def _opened(path: Path) -> pa.NativeFile:
    """The file for arrow, which takes a name of text for UTF-8; that of a file need not be."""
    return pa.OSFile(os.fsencode(path))


def _check_footer(name: str, file: BinaryIO) -> None:
    """Refuse a footer that is so long that it can only describe thousands of columns or parts."""
    length = file.seek(0, os.SEEK_END)
    file.seek(max(0, length - 8))
    size, end = int.from_bytes(file.read(4), "little"), file.read(4)
    file.seek(0)
    if end == _PARQUET and _LONGEST_FOOTER < size < length:
        raise FlightLogError(
            f"{name} describes its columns in {counted(size, 'byte')}: give one row per sample, one column per "
            f"quantity ({MOST_COLUMNS:,} at most), and large row groups"
        )


def _check_chunks(name: str, metadata: Any) -> None:
    """Refuse a part of a column that says it unpacks to more than the numbers of a log can take."""
    for group in range(metadata.num_row_groups):
        for column in range(metadata.num_columns):
            chunk = metadata.row_group(group).column(column)
            if chunk.total_uncompressed_size > _LARGEST_CHUNK:
                raise FlightLogError(
                    f"{name}: column {printable(chunk.path_in_schema)} unpacks to "
                    f"{chunk.total_uncompressed_size / 1e6:,.0f} MB: write numbers, or smaller row groups"
                )


def _as_said(table: Table, said: str) -> Table:
    """The table with what ``auv-log convert`` said of it; as it is where that is nothing."""
    if not said:
        return table
    try:
        content = json.loads(said)
        drift = {axis: _size(rate, axis) for axis, rate in content["drift"].items() if axis in AXES}
        errors = SampleErrors(_size(content["snapshot_s"], "snapshot_s"), drift)
        autopilot = {name: _float(value, name) for name, value in content["autopilot"].items()}
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise FlightLogError(
            f"{table.name}: what auv-log said of it is damaged ({printable(_first_line(error))}): convert the log "
            "again, or remove the remark"
        ) from error
    columns = dict(table.columns)
    measured = columns.pop(MEASURED, None)
    told = {"units_known": True, "errors": errors, "autopilot": autopilot}
    return replace(table, columns=columns, measured=None if measured is None else measured > 0, **told)


def _float(value: object, name: str) -> float:
    """A number of a remark. JSON's whole numbers may have any number of digits."""
    if isinstance(value, bool) or not isinstance(value, int | float) or abs(value) > LARGEST:
        raise ValueError(f"{name} is no number that can be used")
    return float(value)


def _size(value: object, name: str) -> float:
    if not 0 <= (size := _float(value, name)) < np.inf:
        raise ValueError(f"{name} is {size:g}, which is no size")
    return size


def _collect(
    name: str, names: Iterable[str], batches: Iterable[pa.RecordBatch]
) -> tuple[dict[str, Floats], dict[str, str], dict[str, Odd]]:
    """By column its values, how they are written, and its entries that are no number."""
    shown = [column_name(column) for column in names]
    if repeated := sorted(column for column, times in Counter(shown).items() if times > 1):
        raise FlightLogError(f"{name} has the column {', '.join(repeated[:5])} more than once: keep one of each")
    blocks: dict[str, list[Floats]] = {column: [] for column in shown}
    written = {column: Counter[str]() for column in shown}
    odd = {column: Odd() for column in shown}
    rows = 0
    for batch in batches:
        check_size(name, rows + batch.num_rows, len(shown))
        for column, block in zip(shown, batch.columns, strict=True):
            values, how = read_cells(block, odd[column], rows)
            blocks[column].append(values)
            written[column][how] += int(np.isfinite(values).sum())
        rows += batch.num_rows
        if rows >= _BATCH_ROWS:
            log.info("read %d rows of %s", rows, name)
    pa.default_memory_pool().release_unused()  # it keeps what it read the file with, twice as much as the numbers
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


def _odd_findings(odd: dict[str, Odd], row: np.ndarray) -> list[Finding]:
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


def _first_line(error: Exception) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0]


def _cause(error: Exception) -> str:
    """Why arrow cannot read a file, in words of a table where there are any."""
    cause = printable(_first_line(error))
    if "straddling object" in cause:
        return f"a row is longer than {_BLOCK_BYTES >> 20} MB"
    if "out of sync" in cause:
        return "a value in quotation marks goes on over several lines"
    return f"{_MOST_RAGGED:,} rows do not have as many values as the header" if "CSV parse error" in cause else cause
