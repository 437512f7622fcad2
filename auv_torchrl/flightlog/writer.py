"""Write a flight log in the format that :func:`auv_torchrl.flightlog.read_flightlog` reads."""

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from auv_torchrl.extras import library
from auv_torchrl.files import whole
from auv_torchrl.flightlog.findings import FlightLogError
from auv_torchrl.flightlog.log import AXES, FlightLog
from auv_torchrl.flightlog.tables.csv_text import csv_blocks
from auv_torchrl.flightlog.tables.header import NOTE
from auv_torchrl.flightlog.tables.table import MEASURED, NOTE_KEY, Table


def write_flightlog(log: FlightLog, path: str | os.PathLike[str], replace: bool = False) -> Path:
    """Write thruster commands and measured axes as CSV, or as Parquet if the name ends so; atomic.

    Raises:
        FileExistsError: if the file is there and is not to be replaced.
    """
    return write_columns(raw_columns(log), path, replace)


def write_table(table: Table, path: str | os.PathLike[str], replace: bool = False) -> Path:
    """Write the log of a vehicle as :func:`write_columns` does, with all that a diagnosis reads of it.

    Raises:
        FileExistsError: if the file is there and is not to be replaced.
    """
    columns = dict(table.columns)
    if table.measured is not None:
        columns[MEASURED] = table.measured.astype(float)
    return write_columns(columns, path, replace, table.note if table.units_known else "")


def write_columns(
    columns: Mapping[str, np.ndarray], path: str | os.PathLike[str], replace: bool = False, note: str = ""
) -> Path:
    """Write columns (T,) by name, as they are, to a file of the same format; atomic.

    ``note`` is what is to be said of them: a remark above them, in Parquet an entry of the schema.

    Raises:
        FileExistsError: if the file is there and is not to be replaced.
    """
    path = Path(path)
    if path.exists() and not replace:
        raise FileExistsError(f"{path} exists: remove it or choose another name")
    if path.suffix.lower() in (".parquet", ".pq"):
        return _write_parquet(columns, path, note)
    with whole(path) as partial, partial.open("wb") as file:
        file.write(f"{NOTE}{note}\n".encode() if note else b"")
        file.writelines(csv_blocks(columns))
    return path


def _write_parquet(columns: Mapping[str, np.ndarray], path: Path, note: str) -> Path:
    pa = library("pyarrow", "Parquet is written by", "logs", FlightLogError)
    from pyarrow import parquet  # here, not above: few logs are

    table = pa.table(dict(columns)).replace_schema_metadata({NOTE_KEY: note} if note else None)
    with whole(path) as partial, partial.open("wb") as file:
        parquet.write_table(table, file)
    return path


class GrowingLog:
    """A log as CSV that grows while the flight goes on: whenever the process ends, the file has whole rows.

    Args:
        path: of a file that there is not yet.

    Raises:
        FileExistsError: if there is one.
    """

    def __init__(self, path: Path):
        self._file = path.open("xb")
        self._begun = False

    def write(self, columns: Mapping[str, np.ndarray]) -> None:
        """Add rows: columns (T,) by name, the same ones each time."""
        self._file.writelines(csv_blocks(columns, header=not self._begun))
        self._begun = True
        self._file.flush()

    def close(self) -> None:
        """Add no more."""
        self._file.close()


def raw_columns(log: FlightLog) -> dict[str, np.ndarray]:
    """The columns (T,) of a log by name, as its file holds them: episode, t, measured axes, commands, battery."""
    episodes = log.episodes
    columns: dict[str, np.ndarray] = {
        "episode": np.concatenate([np.full(len(e), e.number, dtype=np.int64) for e in episodes])
    }
    columns["t"] = np.concatenate([e.t for e in episodes])
    values = np.concatenate([e.values for e in episodes])
    columns.update({axis: values[:, i] for i, axis in enumerate(AXES) if axis in log.axes})
    commands = np.concatenate([e.commands for e in episodes])
    columns.update({f"cmd_{i + 1}": commands[:, i] for i in range(commands.shape[1])})
    if all(e.battery is not None for e in episodes):
        columns["battery"] = np.concatenate([e.battery for e in episodes if e.battery is not None])
    return columns
