"""The trial without the firmware: dives that it flew once are diagnosed again."""

import json
import logging
import lzma
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from auv_torchrl.paths import PROJECT
from benchmarks.trial.work import answer

log = logging.getLogger(__name__)
FOLDER = PROJECT / "tests" / "link" / "recorded"
ABOUT = "dives.json"


def small(folder: Path = FOLDER) -> int:
    """Diagnose what is recorded and print what is said; 0 where all of it is as it has to be."""
    wrong = [name for name, right in verdicts(folder) if not right]
    return 1 if wrong else 0


def verdicts(folder: Path) -> Iterator[tuple[str, bool]]:
    """Each recorded dive, and whether the answer is the one that it has to be."""
    told: dict[str, Any] = json.loads((folder / ABOUT).read_text())
    for name, expected in told["dives"].items():
        with TemporaryDirectory() as unpacked:
            path = Path(unpacked) / f"{name}.BIN"
            path.write_bytes(lzma.decompress((folder / f"{name}.BIN.xz").read_bytes()))
            found, seconds = answer(path, [], told["vehicle"])
        named = {k: p.value for e in found.effects if e.is_likely for k, p in e.parameters.items() if not p.is_nominal}
        log.info("%s: %s, %s (%.0f s)", name, found.verdict.key, named, seconds)
        near = named.keys() == expected["named"].keys() and all(
            abs(named[k] - value) < 0.2 for k, value in expected["named"].items()
        )
        yield name, found.verdict.key == expected["verdict"] and near
