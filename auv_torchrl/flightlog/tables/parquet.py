"""A Parquet file as columns of float64; imported where one is to be read, because pyarrow need not be installed."""

import os
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa
from pyarrow.parquet import ParquetFile

from auv_torchrl.flightlog.findings import Finding, FlightLogError, Severity
from auv_torchrl.flightlog.log import Floats
from auv_torchrl.flightlog.tables.cells import DATE, NUMBER, Odd, bounded, is_no_value, read_cells
from auv_torchrl.flightlog.tables.header import MOST_COLUMNS, check_number
from auv_torchrl.flightlog.tables.table import (
    NOTE_KEY,
    PARQUET,
    Table,
    as_noted,
    check_size,
    collect,
    column_name,
    first_line,
    odd_findings,
    unreadable,
)
from auv_torchrl.quantities import counted
from auv_torchrl.text import printable

_BATCH_NUMBERS = 1_000_000  # of all columns together that Parquet is unpacked to at a time
_LONGEST_FOOTER = 8 << 20  # bytes; of 1,000 columns in 20 row groups it takes 2 MB
_LARGEST_CHUNK = 128 << 20  # bytes; a column of 5,000,000 numbers takes 40 MB
_PER_SECOND = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}


def read_parquet(path: Path) -> Table:
    """Every column of a Parquet file that holds one number a row.

    Raises:
        FlightLogError: for a file that cannot be read, or unpacks to more than a log can be.
    """
    try:
        return _read(path)
    except pa.ArrowException as error:
        raise unreadable(printable(path.name), "Parquet", first_line(error)) from error


def _read(path: Path) -> Table:
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
            note = (file.schema_arrow.metadata or {}).get(NOTE_KEY, b"").decode()
        opened.seek(0)
        with ParquetFile(opened, read_dictionary=text) as file:  # a long text that repeats is held once
            batches = file.iter_batches(max(1, _BATCH_NUMBERS // max(len(flat), 1)), columns=flat)
            columns, written, odd = collect(name, flat, (batch.columns for batch in batches), read_array)
    pa.default_memory_pool().release_unused()  # it keeps what it read the file with, twice as much as the numbers
    row = np.arange(1, len(next(iter(columns.values()), ())) + 1)
    findings = odd_findings(odd, row)
    if nested:
        sentence = f"{', '.join(nested[:5])}{' and others' if len(nested) > 5 else ''} hold no single numbers: left out"
        remedy = "Write one number per row and column"
        findings.append(Finding(Severity.WARNING, "nested_columns", sentence, remedy, tuple(nested[:5])))
    return as_noted(Table(name, columns, row, tuple(findings), written=written), note)


def _opened(path: Path) -> pa.NativeFile:
    """The file for arrow, which takes a name of text for UTF-8; that of a file need not be."""
    return pa.OSFile(os.fsencode(path))


def _check_footer(name: str, file: BinaryIO) -> None:
    """Refuse a footer that is so long that it can only describe thousands of columns or parts."""
    length = file.seek(0, os.SEEK_END)
    file.seek(max(0, length - 8))
    size, end = int.from_bytes(file.read(4), "little"), file.read(4)
    file.seek(0)
    if end == PARQUET and _LONGEST_FOOTER < size < length:
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


def is_flat(kind: pa.DataType) -> bool:
    """Whether a column of this type has one value a row that may be a number."""
    if pa.types.is_dictionary(kind):
        return is_flat(kind.value_type)
    return (
        pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind) or _is_text(kind)
        or pa.types.is_boolean(kind) or pa.types.is_null(kind) or pa.types.is_timestamp(kind)
        or pa.types.is_duration(kind)
    )  # fmt: skip


def _is_text(kind: pa.DataType) -> bool:
    return pa.types.is_string(kind) or pa.types.is_large_string(kind)


def read_array(array: pa.Array, odd: Odd, offset: int) -> tuple[Floats, str]:
    """As :func:`auv_torchrl.flightlog.tables.cells.read_cells` does of texts, of a block of any type that is flat."""
    kind = array.type
    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
        per_second = _PER_SECOND[kind.unit]
        return _float64(array.cast(pa.int64())) / per_second, DATE if pa.types.is_timestamp(kind) else NUMBER
    if pa.types.is_dictionary(kind):
        return _of_dictionary(array, odd, offset)
    if _is_text(kind):
        return read_cells(array.to_pylist(), odd, offset)
    return bounded(_float64(array.cast(pa.float64(), safe=False))), NUMBER


def _of_dictionary(array: pa.DictionaryArray, odd: Odd, offset: int) -> tuple[Floats, str]:
    """Each distinct entry is read once, so that a long text that is repeated costs nothing."""
    distinct = Odd()
    by_code, written = read_array(array.dictionary, distinct, 0)
    codes = array.indices.fill_null(-1).to_numpy(zero_copy_only=False)
    values = np.concatenate([by_code, [np.nan]])[codes]
    if distinct.count:
        texts = [None if entry is None else str(entry) for entry in array.dictionary.to_pylist()]
        none = np.array([entry is None or is_no_value(entry) for entry in texts], bool)
        known = np.append(np.isfinite(by_code) | none, True)[codes]
        odd.add([None if code < 0 else texts[code] for code in codes.tolist()], np.flatnonzero(~known), offset)
    return values, written


def _float64(array: pa.Array) -> Floats:
    """Values (T,); NaN where there is none. Arrow's own way to numpy loads pandas where there are gaps."""
    if array.null_count:
        array = array.cast(pa.float64(), safe=False).fill_null(np.nan)
    return np.array(np.from_dlpack(array), dtype=np.float64) if len(array) else np.empty(0)
