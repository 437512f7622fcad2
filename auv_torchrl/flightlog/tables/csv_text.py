"""Columns of numbers as the text of a CSV file."""

from collections.abc import Iterator, Mapping

import numpy as np

DIGITS = 6  # micrometres and microradians
_BLOCK_ROWS = 10_000


def csv_blocks(columns: Mapping[str, np.ndarray], header: bool = True) -> Iterator[bytes]:
    """Columns (T,) by name as lines of numbers, an empty entry where there is none; a header unless it is there."""
    if header:
        yield (",".join('"' + name.replace('"', '""') + '"' for name in columns) + "\n").encode()
    rows = max(map(len, columns.values()), default=0)
    for begin in range(0, rows, _BLOCK_ROWS):
        written = [_entries(np.asarray(values)[begin : begin + _BLOCK_ROWS]) for values in columns.values()]
        yield "".join(f"{line}\n" for line in map(",".join, zip(*written, strict=True))).encode()


def _entries(values: np.ndarray) -> list[str]:
    if values.dtype.kind in "iub":
        return list(map(str, values.astype(int).tolist()))
    rounded = np.round(values.astype(float), DIGITS) + 0.0  # no -0
    return ["" if value != value else repr(value) for value in rounded.tolist()]
