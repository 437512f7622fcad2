"""A table of the report."""

from typing import NamedTuple


class Table(NamedTuple):
    """A table with a title."""

    title: str
    head: tuple[str, ...]
    rows: list[tuple[str, ...]]
