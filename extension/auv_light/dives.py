"""What is kept of dives: one JSON file, written whole, and a folder of results for each dive.

The log folder itself is only read. A dive is a log of the autopilot, or where the autopilot keeps its logs to itself a
recording of BlueOS.
"""

import calendar
import hashlib
import json
import re
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path

from auv_torchrl.files import write_text

FILE = "dives.json"
LOG, RECORDING = ".bin", ".mcap"
_BEGUN = re.compile(r"[0-9]{8}_[0-9]{6}")  # UTC, in the name of a recording


@dataclass
class Dive:
    """One log, and what was found in it."""

    id: str
    name: str
    log: str  # path relative to the log folder
    bytes: int
    changed: float  # s since 1970
    sound: bool = False  # as the owner has marked it
    light: str = ""  # empty until it is diagnosed
    summary: str = ""
    against: list[str] = field(default_factory=list)  # dives marked sound that it was held against
    thrusters: list[dict[str, float]] = field(default_factory=list)  # work of each, see odometer
    worked: bool = False  # whether the odometer has read it

    @property
    def is_diagnosed(self) -> bool:
        """Whether it has a light, or a reason for having none."""
        return bool(self.light or self.summary)

    @property
    def is_recording(self) -> bool:
        """Whether its log is a recording of BlueOS, which has telemetry alone."""
        return self.log.lower().endswith(RECORDING)


class Dives:
    """The dives of a vehicle, newest first.

    Args:
        logs: folder of the autopilot's logs.
        kept: folder of what is kept of them.
    """

    def __init__(self, logs: Path, kept: Path) -> None:
        self.logs, self.kept = logs, kept
        kept.mkdir(parents=True, exist_ok=True)
        content = (kept / FILE).read_text(encoding="utf-8") if (kept / FILE).is_file() else "[]"
        self._dives = {entry["id"]: Dive(**entry) for entry in json.loads(content)}

    def __iter__(self) -> Iterator[Dive]:
        return iter(sorted(list(self._dives.values()), key=lambda dive: (dive.changed, dive.name), reverse=True))

    def __getitem__(self, id: str) -> Dive:
        return self._dives[id]

    def look(self, before: float) -> None:
        """Take in logs that nobody has written to since ``before``, s since 1970.

        A recording is left out where a log of the autopilot was written to since it began: that log holds the same
        dive, with the sensors themselves and at higher rates.
        """
        files = [path for path in sorted(self.logs.rglob("*")) if not path.is_symlink() and path.is_file()]
        logs = [path for path in files if path.suffix.lower() == LOG]
        latest = max((path.stat().st_mtime for path in logs), default=0.0)
        recordings = [path for path in files if path.suffix.lower() == RECORDING and latest < _begun(path.name)]
        for path in (*logs, *recordings):
            status = path.stat()
            id = hashlib.sha256(f"{path.relative_to(self.logs)} {status.st_size}".encode()).hexdigest()[:16]
            if status.st_size and status.st_mtime <= before and id not in self._dives:
                inside = path.relative_to(self.logs).as_posix()
                self._dives[id] = Dive(id, path.name, inside, status.st_size, status.st_mtime)
        self.save()

    def healthy(self, dive: Dive) -> list[Dive]:
        """Other dives that are marked sound and still there, of logs of the same kind."""
        alike = [other for other in self if other.is_recording == dive.is_recording and other.id != dive.id]
        return [other for other in alike if other.sound and self.path(other).is_file()]

    def path(self, dive: Dive) -> Path:
        """Its log."""
        return self.logs / dive.log

    def results(self, dive: Dive) -> Path:
        """The folder of its diagnosis."""
        return self.kept / "results" / dive.id

    def save(self) -> None:
        """Write all that is known, at once."""
        write_text(self.kept / FILE, json.dumps([asdict(dive) for dive in self], indent=1) + "\n")


def _begun(name: str) -> float:
    """When a recording began, s since 1970, as its name says; soon after 1970 where it does not."""
    found = _BEGUN.search(name)
    try:
        return float(calendar.timegm(time.strptime(found[0], "%Y%m%d_%H%M%S"))) if found else 1.0
    except ValueError:  # digits that are no time
        return 1.0
