"""The rows of a CSV file, block by block, so that its text is never held at once."""

import csv
from array import array
from collections.abc import Iterator, Sequence
from itertools import compress
from pathlib import Path

BLOCK_BYTES = 1 << 20
LONGEST_ROW = 8 << 20  # bytes
MOST_RAGGED = 1_000_000  # rows with too many or too few values: such a file is no table
# How programs write that there is no value.
NO_VALUES = frozenset(
    ("", "#N/A", "#N/A N/A", "#NA", "-1.#IND", "-1.#QNAN", "-NaN", "-nan", "1.#IND", "1.#QNAN", "N/A", "NA", "NULL",
     "NaN", "n/a", "nan", "null")
)  # fmt: skip

Column = Sequence[str | None]


class UnreadableRows(ValueError):
    """The rows are none of a table; the message says why."""


class Rows:
    """The rows below the header of a CSV file, which is known to be in UTF-8.

    Args:
        path: of the file.
        above: lines before the rows, the header included.
        columns: of the header.
    """

    def __init__(self, path: Path, above: int, columns: int):
        self._path, self._above, self._columns = path, above, columns
        self.ragged = array("q")  # rows from 1, without blank lines, that have more or fewer values
        self.lengths = array("q")  # how many those have

    def blocks(self) -> Iterator[list[Column]]:
        """By column, entries of as many rows as a block has; None where there is no value.

        Raises:
            UnreadableRows: for a row that is too long or goes on over several lines, or too many ragged ones.
        """
        number = 0
        for text in self._texts():
            lines = [line for line in text.replace("\r\n", "\n").replace("\r", "\n").split("\n") if line]
            rows = _quoted(lines) if '"' in text else [line.split(",") for line in lines]
            even = [len(row) == self._columns for row in rows]
            if not all(even):
                self._note(number, rows, even)
                rows = list(compress(rows, even))
            number += len(lines)
            if rows:
                yield [_with_gaps(column) for column in zip(*rows, strict=True)]

    def _texts(self) -> Iterator[str]:
        """Blocks of whole lines."""
        with self._path.open("rb") as file:
            for _ in range(self._above):
                file.readline()
            while block := file.read(BLOCK_BYTES):
                block += file.readline(LONGEST_ROW)
                if len(block) >= LONGEST_ROW and not block.endswith(b"\n"):
                    raise UnreadableRows(f"a row is longer than {LONGEST_ROW >> 20} MB")
                yield block.decode("utf-8")

    def _note(self, before: int, rows: list[list[str]], even: list[bool]) -> None:
        for place, (row, is_even) in enumerate(zip(rows, even, strict=True)):
            if not is_even:
                self.ragged.append(before + place + 1)
                self.lengths.append(len(row))
        if len(self.ragged) >= MOST_RAGGED:
            raise UnreadableRows(f"{MOST_RAGGED:,} rows do not have as many values as the header")


def _quoted(lines: list[str]) -> list[list[str]]:
    """Lines of which some have values in quotation marks."""
    if any(line.count('"') % 2 for line in lines):
        raise UnreadableRows("a value in quotation marks goes on over several lines")
    try:
        return [next(csv.reader((line,))) if '"' in line else line.split(",") for line in lines]
    except csv.Error as error:
        raise UnreadableRows(str(error)) from error


def _with_gaps(column: tuple[str, ...]) -> Column:
    if NO_VALUES.isdisjoint(column):
        return column
    return [None if entry in NO_VALUES else entry for entry in column]
