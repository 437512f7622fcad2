"""What was worked out of dives, kept under a hash of everything that shaped it: a killed run goes on where it was.

Another version of the program, another vehicle or another reference has other hashes, and finds nothing of these.
"""

import hashlib
import json
import logging
from collections.abc import Mapping
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from auv_torchrl import __version__
from auv_torchrl.diagnosis.dives.dives_file import finding_from, plain
from auv_torchrl.diagnosis.dives.told import Dive, Normal, Number
from auv_torchrl.files import write_whole
from auv_torchrl.paths import own_folder

log = logging.getLogger(__name__)

_DIGITS = 20  # of the hash, in names of files
_BLOCK = 1 << 20  # bytes read at once


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
            if part.is_file():
                summed.update(_digest(part))
    return summed.hexdigest()[:_DIGITS]


def keep_dive(folder: Path, key: str, dive: Dive) -> None:
    """Keep what one dive tells."""
    _write(folder, f"dive_{key}.json", {**asdict(dive), "noise": dict(dive.noise)})


def kept_dive(folder: Path, key: str) -> Dive | None:
    """The dive that was kept; None where there is none that can be read."""
    content = _read(folder / f"dive_{key}.json")
    if content is None:
        return None
    findings = tuple(finding_from(entry) for entry in content["findings"])
    excess = np.nan if content["excess"] is None else content["excess"]
    return Dive(**{**content, "A": np.array(content["A"]), "h": np.array(content["h"]), "findings": findings,
                   "excess": excess})  # fmt: skip


def keep_normal(folder: Path, key: str, normal: Normal) -> None:
    """Keep how the sound vehicle is."""
    _write(folder, f"reference_{key}.json", {**asdict(normal), "noise": dict(normal.noise)})


def kept_normal(folder: Path, key: str) -> Normal | None:
    """The sound vehicle that was kept; None where there is none that can be read."""
    content = _read(folder / f"reference_{key}.json")
    if content is None:
        return None
    numbers = tuple(Number(**entry) for entry in content["numbers"])
    findings = tuple(finding_from(entry) for entry in content["findings"])
    return Normal(numbers, np.array(content["covariance"]), content["noise"], findings)


def _digest(path: Path) -> bytes:
    summed = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(_BLOCK):
            summed.update(block)
    return summed.digest()


def _write(folder: Path, name: str, content: Mapping[str, Any]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    arrays = {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in content.items()}
    write_whole(folder / name, json.dumps(plain(arrays), allow_nan=False).encode("utf-8", "surrogateescape"))


def _read(path: Path) -> dict[str, Any] | None:
    try:
        return json.loads(path.read_bytes())
    except FileNotFoundError:
        return None
    except ValueError:
        log.warning("%s cannot be read: it is worked out again", path)
        return None
