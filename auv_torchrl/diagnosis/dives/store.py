"""What was worked out of dives, kept under a hash of everything that shaped it: a killed run goes on where it was.

Another version of the program, another vehicle or another reference has other hashes, and finds nothing of these.
"""

import hashlib
import json
import logging
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from auv_torchrl import __version__
from auv_torchrl.diagnosis.dives.told import Dive, Normal
from auv_torchrl.diagnosis.plain import from_plain, plain
from auv_torchrl.files import say_not_kept, write_text
from auv_torchrl.paths import own_folder

log = logging.getLogger(__name__)
Kept = TypeVar("Kept", Dive, Normal)

_DIGITS = 20  # of the hash, in names of files


@cache
def program() -> str:
    """Version of the program, and a hash of its sources and of Python of one's own."""
    package, own = Path(__file__).resolve().parents[2], own_folder()
    summed = hashlib.sha256(__version__.encode())
    for folder in [package, *([own] if own else [])]:
        for path in sorted(folder.rglob("*.py")):
            summed.update(path.relative_to(folder).as_posix().encode() + path.read_bytes())
    return summed.hexdigest()


def key_of(settings: Mapping[str, Any], *files: Path) -> str:
    """The name under which what follows from settings and files is kept."""
    summed = hashlib.sha256(json.dumps([program(), plain(dict(settings))], sort_keys=True, default=str).encode())
    for file in files:
        for part in sorted(file.rglob("*")) if file.is_dir() else [file]:
            summed.update(_digest(part))
    return summed.hexdigest()[:_DIGITS]


def _digest(path: Path) -> bytes:
    """Of the content of a file; of its name where it has none that can be read, until it can."""
    try:
        if path.is_file():  # a pipe may never end
            with path.open("rb") as content:
                return hashlib.file_digest(content, "sha256").digest()
    except OSError as error:
        log.debug("%s: %s", path, error)
    return path.name.encode(errors="surrogateescape")


def keep(folder: Path, key: str, told: Dive | Normal) -> None:
    """Keep what one dive tells, or how the sound vehicle is; where there is no room, the answer is all the same."""
    content = json.dumps(plain(told), allow_nan=False)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_text(_file(folder, key, type(told)), content)
    except OSError as error:
        say_not_kept(error.strerror or str(error))


def kept(folder: Path, key: str, kind: type[Kept]) -> Kept | None:
    """What was kept; None where there is none that can be read."""
    path = _file(folder, key, kind)
    try:
        return from_plain(kind, json.loads(path.read_bytes()))
    except FileNotFoundError:
        return None
    except (KeyError, ValueError):
        log.warning("%s cannot be read: it is worked out again", path)
        return None


def _file(folder: Path, key: str, kind: type[Dive | Normal]) -> Path:
    return folder / f"{'dive' if kind is Dive else 'reference'}_{key}.json"
