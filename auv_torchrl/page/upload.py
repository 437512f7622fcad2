"""A request that brings logs: streamed to disk within bounds, under names that mean nothing to a shell or a system.

A body is either one log (``POST /logs?name=dive.BIN``) or a form with one or many files. No part of it is held in
memory beyond the piece that has just come.
"""

import hashlib
import re
import secrets
import shutil
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from auv_torchrl.extras import library
from auv_torchrl.page.refusal import Refusal
from auv_torchrl.quantities import counted

multipart = library("python_multipart.multipart", "the page needs", "page")

MOST_BYTES = 2 << 30  # of one log
MOST_FILES = 100  # of one request
_MOST_HEADER = 16 << 10  # bytes of the headers of one part of a form
_SPARE_BYTES = 512 << 20  # that stay free on the disk
_LONGEST = 80  # characters of a name on disk; its end has the suffix
_SHOWN = 200  # characters of a name that are kept for people
_RESERVED = re.compile(r"(con|prn|aux|nul|com[0-9]|lpt[0-9])(\.|$)", re.I)  # names that Windows keeps for devices


class UploadError(Refusal):
    """A request that brings no logs, or too much."""


@dataclass(frozen=True)
class Upload:
    """A file that has come."""

    path: Path  # in the folder for what comes
    name: str  # as it was called, for people
    size: int
    digest: str


def stored_name(name: str) -> str:
    """The name of a log on disk: its last part, of letters, digits, dot, dash and underline alone, with its suffix."""
    last = re.split(r"[/\\]", name)[-1]
    kept = re.sub(r"[^A-Za-z0-9._-]", "_", last)[-_LONGEST:].lstrip(".-").rstrip(".")
    return f"log_{kept}" if not kept or _RESERVED.match(kept) else kept


class _Files:
    """The files of one request, written as their pieces come."""

    def __init__(self, folder: Path, most_bytes: int) -> None:
        self.folder, self.most_bytes = folder, most_bytes
        self.done: list[Upload] = []
        self._open: BinaryIO | None = None
        self._name, self._size, self._digest = "", 0, hashlib.sha256()

    def begin(self, name: str) -> None:
        """A further file begins."""
        if len(self.done) >= MOST_FILES:
            raise UploadError(f"more than {MOST_FILES} files at once: give them in several goes", 413)
        self._name, self._size, self._digest = name[:_SHOWN], 0, hashlib.sha256()
        self._open = (self.folder / secrets.token_hex(8)).open("xb")

    def write(self, piece: bytes) -> None:
        """A piece of it has come."""
        if self._open is None:
            return  # of a field that is no file
        self._size += len(piece)
        if self._size > self.most_bytes:
            raise UploadError(
                f"a log has {self.most_bytes / 1e9:.2g} GB at most: cut it, or diagnose it by auv-diagnose", 413
            )
        self._digest.update(piece)
        self._open.write(piece)

    def end(self) -> None:
        """It is complete."""
        if self._open is not None:
            self._open.close()
            self.done.append(Upload(Path(self._open.name), self._name, self._size, self._digest.hexdigest()))
            self._open = None

    def discard(self) -> None:
        """Delete all that has come, as where the rest does not come."""
        self.end()
        for upload in self.done:
            upload.path.unlink(missing_ok=True)


async def receive(
    body: AsyncIterator[bytes], content_type: str, length: int, name: str, folder: Path, most_bytes: int = MOST_BYTES
) -> list[Upload]:
    """The files of a request, in ``folder``.

    Args:
        body: piece by piece.
        content_type: as the request says.
        length: as the request says; 0 where it does not.
        name: of a body that is a log itself.
        folder: to write to.
        most_bytes: of one log.

    Raises:
        UploadError: if there is none, if one is too large, or if the disk is full; nothing is left of them then.
    """
    if length > shutil.disk_usage(folder).free - _SPARE_BYTES:
        raise UploadError("the disk has no room for this: delete dives, or choose another folder", 507)
    files = _Files(folder, most_bytes)
    try:
        kind, options = multipart.parse_options_header(content_type)
        if kind == b"multipart/form-data":
            await _read_form(body, options.get(b"boundary", b""), files)
        else:
            if not name:
                raise UploadError("give a form with files, or the log itself and its name as ?name=dive.BIN")
            files.begin(name)
            async for piece in body:
                files.write(piece)
            files.end()
        if not any(upload.size for upload in files.done):
            raise UploadError(f"{counted(len(files.done), 'file')}, and none holds anything: choose a log")
    except OSError as error:
        files.discard()
        raise UploadError(f"the log cannot be kept ({error.strerror})", 507) from error
    except BaseException:
        files.discard()
        raise
    for upload in files.done:
        if not upload.size:
            upload.path.unlink()
    return [upload for upload in files.done if upload.size]


async def _read_form(body: AsyncIterator[bytes], boundary: bytes, files: _Files) -> None:
    if not boundary:
        raise UploadError("the form names no boundary")
    header: list[bytes] = [b"", b""]  # name and value of the one that is read
    seen = {"bytes": 0, "ended": False}

    def field(data: bytes, start: int, end: int) -> None:
        grow(0, data[start:end])

    def value(data: bytes, start: int, end: int) -> None:
        grow(1, data[start:end])

    def grow(part: int, piece: bytes) -> None:
        seen["bytes"] += len(piece)
        if seen["bytes"] > _MOST_HEADER:
            raise UploadError("the form has headers that are too long", 413)
        header[part] += piece

    def header_ends() -> None:
        if header[0].lower() == b"content-disposition":
            _, options = multipart.parse_options_header(header[1])
            if b"filename" in options:
                files.begin(options[b"filename"].decode("utf-8", "replace"))
        header[:] = [b"", b""]

    def part_begins() -> None:
        files.end()  # of a part with two such headers
        seen["bytes"] = 0

    def form_ends() -> None:
        seen["ended"] = True

    callbacks: dict[str, Any] = {
        "on_part_begin": part_begins, "on_header_field": field, "on_header_value": value, "on_header_end": header_ends,
        "on_part_data": lambda data, start, end: files.write(data[start:end]), "on_part_end": files.end,
        "on_end": form_ends,
    }  # fmt: skip
    try:
        parser = multipart.MultipartParser(boundary, callbacks)
        async for piece in body:
            parser.write(piece)
        parser.finalize()
    except multipart.MultipartParseError as error:
        raise UploadError(f"the form cannot be read ({error})") from error
    if not seen["ended"]:
        raise UploadError("the form ends in its middle: send it again")
