"""Where the table in a CSV file begins and what its columns are called, or why it is no such table."""

import codecs
import csv
import os
import re
import stat
from pathlib import Path
from typing import NamedTuple

from auv_torchrl.flightlog.findings import FlightLogError
from auv_torchrl.quantities import counted
from auv_torchrl.text import printable

MOST_COLUMNS = 1000  # fifty times what a log needs; a file with more has its samples side by side, or is no log
_LONGEST_LINE = 1 << 20  # bytes
_MOST_REMARKS = 1000  # lines before the header
_BLOCK_BYTES = 8 << 20
_UTF_16 = (b"\xff\xfe", b"\xfe\xff")
_FOREIGN = {
    b"PK\x03\x04": "an Excel or ZIP file",
    b"\x1f\x8b": "compressed by gzip",
    b"\x89HDF": "an HDF5 or MATLAB file",
    b"SQLi": "an SQLite database (a ROS bag?)",
    b"ULog": "a PX4 log",
    b"\xa3\x95": "an ArduPilot log",
}
NOTE = "# auv-log: "  # begins a remark with what a converted log says beside its columns
_SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars"}
_NUMBER = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?|nan|", re.ASCII | re.IGNORECASE)


class Header(NamedTuple):
    """The line that names the columns."""

    names: list[str]
    skipped: int  # lines above it: blank ones and remarks
    note: str  # by ``auv-log convert`` about the columns, as JSON; empty where there is nothing


def first_bytes(path: Path, count: int) -> bytes:
    """How a file begins: ``count`` bytes, or all if there are fewer.

    Raises:
        FlightLogError: for a file that cannot be read, a directory, or a pipe or device, which may never end.
    """
    remedy, shown = "give the path of a log", printable(str(path), None)
    try:
        mode = os.stat(path).st_mode
        if stat.S_ISDIR(mode):
            raise FlightLogError(f"{shown} is a directory: {remedy}")
        if not stat.S_ISREG(mode):
            raise FlightLogError(
                f"{shown} is a pipe or device: {remedy}, what comes out of a pipe kept in a file first"
            )
        with path.open("rb") as file:
            return file.read(count)
    except OSError as error:
        raise FlightLogError(f"{shown}: {error.strerror or error}: {remedy}") from error


def read_header(path: Path) -> Header:
    """The header of a CSV file, the whole of which is checked to be text.

    Raises:
        FlightLogError: for a file that is binary, not in UTF-8, not separated by commas, or without a header.
    """
    name = printable(path.name)
    with path.open("rb") as file:
        _refuse_foreign(name, file.read(256))
        file.seek(0)
        remarks: list[str] = []
        while True:
            line = file.readline(_LONGEST_LINE)
            text = _decoded(name, line).strip()
            if not line or (text and not text.startswith("#") and not text.lower().startswith("sep=")):
                break
            remarks.append(text)
            if len(remarks) > _MOST_REMARKS:
                raise FlightLogError(f"{name} begins with more than {_MOST_REMARKS} lines of remarks: remove them")
        following = _decoded(name, file.readline(_LONGEST_LINE))
        file.seek(0)
        _check_text(name, file)
    if not text:
        raise FlightLogError(f"{name} holds nothing but remarks: give a header line and one row per sample")
    if len(line) == _LONGEST_LINE:
        raise FlightLogError(f"{name}: its first line is longer than {_LONGEST_LINE:,} bytes: give lines of values")
    if "\r" in text:
        raise FlightLogError(f"{name} ends its lines by carriage returns alone: end them by line feeds")
    check_number(name, text.count(",") + 1)
    _check_separator(name, text, following)
    names = _names(name, text)
    if all(_NUMBER.fullmatch(column) for column in names) and any(names):
        commented = next((remark for remark in reversed(remarks) if remark), "")
        remedy = (
            f"remove the # before {printable(commented.lstrip('# '), 40)!r}"
            if commented.count(",") == text.count(",") > 0
            else "give the names of the columns as first line, such as t,x,y,z,yaw,cmd_1"
        )
        raise FlightLogError(f"{name} has no header, its first line holds numbers: {remedy}")
    note = next((remark.removeprefix(NOTE) for remark in remarks if remark.startswith(NOTE)), "")
    return Header(names, len(remarks), note)


def _names(name: str, text: str) -> list[str]:
    """The names in a header line; one in quotes may hold commas.

    Raises:
        FlightLogError: for a name that goes on in the next line.
    """
    try:
        (row,) = csv.reader([text], strict=True)
    except csv.Error as error:
        raise FlightLogError(
            f"{name}: its header cannot be read ({error}): write short names, all on one line, quotation marks in pairs"
        ) from error
    return [column.strip() for column in row]


def check_number(name: str, columns: int) -> None:
    """Refuse a table of thousands of columns before it is read.

    Raises:
        FlightLogError: naming how many there are.
    """
    if columns > MOST_COLUMNS:
        raise FlightLogError(
            f"{name} has {counted(columns, 'column')}, a log has {MOST_COLUMNS:,} at most: "
            "give one row per sample and one column per quantity"
        )


def _refuse_foreign(name: str, head: bytes) -> None:
    every_other = 0 < len(head) <= 3 * head.count(0) and not head.replace(b"\0", b"").strip(_PRINTABLE)
    if head.startswith(_UTF_16) or every_other:
        raise FlightLogError(f"{name} is text in UTF-16, or another code of two or four bytes: save the CSV as UTF-8")
    for magic, kind in _FOREIGN.items():
        if head.startswith(magic):
            raise FlightLogError(f"{name} is {kind}, not CSV or Parquet: export the log as one of them")
    if b"\0" in head:
        raise FlightLogError(f"{name} is a binary file, not CSV or Parquet: export the log as one of them")


_PRINTABLE = bytes([9, 10, 13, *range(32, 127)])


def _check_text(name: str, file) -> None:
    decoder = codecs.getincrementaldecoder("utf-8")()
    try:
        while block := file.read(_BLOCK_BYTES):
            if b"\0" in block:
                raise FlightLogError(f"{name} is a binary file, not CSV or Parquet: export the log as one of them")
            decoder.decode(block)
        decoder.decode(b"", final=True)
    except UnicodeDecodeError as error:
        raise _not_utf_8(name, error) from error


def _decoded(name: str, line: bytes) -> str:
    try:
        return line.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if len(line) == _LONGEST_LINE:
            return line.decode("utf-8-sig", errors="ignore")  # cut within a character
        raise _not_utf_8(name, error) from error


def _not_utf_8(name: str, error: UnicodeDecodeError) -> FlightLogError:
    odd = error.object[error.start]
    return FlightLogError(f"{name} is not in UTF-8 (byte 0x{odd:02x} in it): save the CSV as UTF-8")


def _check_separator(name: str, text: str, following: str) -> None:
    separator = max(_SEPARATORS, key=text.count)
    blanks = "," not in text and len(text.split()) > 1
    if text.count(separator) > text.count(","):
        decimal = re.search(r"[0-9],[0-9]", following) is not None
        more = ", and its numbers have decimal commas" if decimal else ""
        also = " and decimal points" if decimal else ""
        raise FlightLogError(
            f"{name} separates its columns by {_SEPARATORS[separator]}, not commas{more}: export it with commas{also}"
        )
    if blanks and not text.startswith('"'):
        raise FlightLogError(f"{name} separates its columns by blanks, not commas: export it with commas")
