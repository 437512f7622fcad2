"""A CSV or Parquet file as columns of float64, read block by block so that its text is never held at once."""

import json
import logging
import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv

from auv_torchrl.flightlog.findings import Finding, FlightLogError, Severity
from auv_torchrl.flightlog.header import check_number, first_bytes, read_header
from auv_torchrl.flightlog.log import AXES, Floats, SampleErrors

log = logging.getLogger(__name__)

MAX_ROWS = 5_000_000  # 14 h at 100 Hz; 0.5 GB as float64
_PARQUET = b"PAR1"
SAID_KEY = b"auv-log"  # of the same in Parquet
MEASURED = "measured"  # column, 1 in rows in which something was measured
_BLOCK_BYTES = 8 << 20
_BATCH_ROWS = 100_000
_NOT_FINITE = ("", "nan", "inf", "+inf", "-inf")
_LARGEST = 1e18  # beyond any unit of time or length; its square still is a number
_LISTED = 3  # examples that a message quotes


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
    head = first_bytes(path, len(_PARQUET))
    if not head:
        raise FlightLogError(f"{path.name} is empty: give a log that holds samples")
    try:
        table = _read_parquet(path) if head == _PARQUET else _read_csv(path)
    except (pa.ArrowException, OSError, UnicodeError) as error:
        kind = "Parquet" if head == _PARQUET else "CSV"
        raise FlightLogError(
            f"{path.name} cannot be read as {kind} ({_first_line(error)}): give a CSV file with a header line, "
            "comma between values, or a Parquet file"
        ) from error
    if not len(table.row):
        raise FlightLogError(f"{path.name} has a header and no rows: give one row per sample")
    return table


def _read_csv(path: Path) -> Table:
    if path.suffix.lower() in (".parquet", ".pq"):
        raise FlightLogError(f"{path.name} is not a Parquet file although it is named so: export it again")
    names, skipped, said = read_header(path)
    bad_rows: list[int] = []
    lengths: list[int] = []

    def remember(row: pyarrow.csv.InvalidRow) -> str:
        above = skipped + 1  # lines that arrow counts: those skipped and the header
        bad_rows.append(-1 if row.number is None else row.number - above)
        lengths.append(row.actual_columns)
        return "skip"

    with path.open("rb") as file:  # by its name, arrow would take it for packed or not
        reader = pyarrow.csv.open_csv(
            file,
            read_options=pyarrow.csv.ReadOptions(use_threads=False, block_size=_BLOCK_BYTES, skip_rows=skipped),
            parse_options=pyarrow.csv.ParseOptions(invalid_row_handler=remember),
            convert_options=pyarrow.csv.ConvertOptions(
                column_types=dict.fromkeys(names, pa.string()), strings_can_be_null=True
            ),
        )
        columns, texts = _collect(path.name, reader.schema.names, iter(reader))
    rows = len(next(iter(columns.values()), ()))
    kept = np.setdiff1d(np.arange(1, rows + len(bad_rows) + 1), bad_rows)[:rows]
    findings = _text_findings(texts, kept)
    if bad_rows and not rows:
        raise FlightLogError(
            f"{path.name}: the header has {len(names)} columns and none of the {len(bad_rows)} rows below it has as "
            f"many values, the first has {lengths[0]}: give as many, with decimal points instead of decimal commas"
        )
    if bad_rows:
        findings.append(
            Finding(
                Severity.WARNING,
                "ragged_rows",
                f"{len(bad_rows)} rows do not have {len(names)} values like the header and are left out",
                "Check how the file was written or cut",
                rows=(min(bad_rows), max(bad_rows)),
            )
        )
    return _as_said(Table(path.name, columns, kept, tuple(findings)), said)


def _read_parquet(path: Path) -> Table:
    from pyarrow.parquet import ParquetFile  # here, not above: few logs are

    with ParquetFile(path) as file:
        check_number(path.name, len(file.schema_arrow.names))
        said = (file.schema_arrow.metadata or {}).get(SAID_KEY, b"").decode()
        columns, texts = _collect(path.name, file.schema_arrow.names, file.iter_batches(batch_size=_BATCH_ROWS))
    row = np.arange(1, len(next(iter(columns.values()), ())) + 1)
    return _as_said(Table(path.name, columns, row, tuple(_text_findings(texts, row))), said)


def _as_said(table: Table, said: str) -> Table:
    """The table with what ``auv-log convert`` said of it; as it is where that is nothing."""
    if not said:
        return table
    try:
        content = json.loads(said)
        drift = {axis: float(rate) for axis, rate in content["drift"].items() if axis in AXES}
        errors = SampleErrors(float(content["snapshot_s"]), drift)
        autopilot = {name: float(value) for name, value in content["autopilot"].items()}
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise FlightLogError(
            f"{table.name}: what auv-log said of it is damaged ({error}): convert the log again, or remove the remark"
        ) from error
    columns = dict(table.columns)
    measured = columns.pop(MEASURED, None)
    told = {"units_known": True, "errors": errors, "autopilot": autopilot}
    return replace(table, columns=columns, measured=None if measured is None else measured > 0, **told)


def _collect(name, names, batches) -> tuple[dict[str, Floats], dict[str, list[tuple[int, str]]]]:
    stripped = [str(column).strip() for column in names]
    if repeated := sorted(column for column, times in Counter(stripped).items() if times > 1):
        raise FlightLogError(f"{name} has the column {', '.join(repeated[:5])} more than once: keep one of each")
    blocks: dict[str, list[Floats]] = {column: [] for column in stripped}
    texts: dict[str, list[tuple[int, str]]] = {}
    rows = 0
    for batch in batches:
        for column, array in zip(stripped, batch.columns, strict=True):
            values, odd = _numbers(array)
            blocks[column].append(values)
            for index, text in odd:
                texts.setdefault(column, []).append((rows + index, text))
        rows += batch.num_rows
        if rows > MAX_ROWS:
            raise FlightLogError(f"{name} has more than {MAX_ROWS:,} rows: cut it, or log at 20 Hz")
        if rows >= _BATCH_ROWS:
            log.info("read %d rows of %s", rows, name)
    pa.default_memory_pool().release_unused()  # it keeps what it read the file with, twice as much as the numbers
    whole = {column: np.concatenate(blocks.pop(column) or [np.empty(0)]) for column in stripped}
    return whole, texts


def _numbers(array: pa.Array) -> tuple[Floats, list[tuple[int, str]]]:
    """Values as float64, and the entries that are no number; ``to_numpy`` loads pandas, for gaps alone."""
    try:
        numbers = array.cast(pa.float64(), safe=False)
        whole = len(numbers) > 0 and not numbers.null_count
        return _floats(np.from_dlpack(numbers) if whole else numbers.to_numpy(zero_copy_only=False)), []
    except pa.ArrowException:  # some entry is no number: find out which
        import pandas as pd  # 0.7 s, for files that need it

        text = array.cast(pa.string()).to_pandas().str.strip()
    values = _floats(pd.to_numeric(text, errors="coerce"))
    odd = np.isnan(values) & text.notna().to_numpy() & ~text.str.lower().isin(_NOT_FINITE).to_numpy()
    return values, [(int(i), str(text.iloc[i])) for i in np.flatnonzero(odd)]


def _floats(array: Any) -> Floats:
    values = np.array(array, dtype=np.float64)
    values[~(np.abs(values) < _LARGEST)] = np.nan
    return values


def _text_findings(texts: dict[str, list[tuple[int, str]]], row: np.ndarray) -> list[Finding]:
    return [
        Finding(
            Severity.WARNING,
            "not_a_number",
            f"{column} holds {len(entries)} entries that are no number, such as "
            + ", ".join(repr(text[:20]) for _, text in entries[:_LISTED]),
            "Write numbers with a decimal point",
            columns=(column,),
            rows=(int(row[entries[0][0]]), int(row[entries[-1][0]])),
        )
        for column, entries in texts.items()
    ]


def _first_line(error: Exception) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0]
