"""Which logs are dives, which of them are the reference, and in which order they were flown."""

import re
from dataclasses import dataclass
from datetime import datetime
from os.path import realpath
from pathlib import Path

from omegaconf import DictConfig

from auv_torchrl.diagnosis.logs import find_logs, no_logs
from auv_torchrl.flightlog import Finding
from auv_torchrl.quantities import counted

_DATE = re.compile(
    r"(20\d\d)[-_.]?([01]\d)[-_.]?([0-3]\d)(?:[-_. T]?([0-2]\d)[-_.:h]?([0-5]\d)(?:[-_.:]?([0-5]\d))?)?", re.ASCII
)


@dataclass(frozen=True)
class Planned:
    """Dives in their order; the first ones are the reference."""

    paths: tuple[Path, ...]
    begun: tuple[str, ...]  # date and time as far as the name of the file has them; else empty
    reference: int  # how many
    findings: tuple[Finding, ...] = ()  # what their folder holds besides


def plan(config: DictConfig) -> Planned:
    """The dives that a config names.

    Raises:
        ValueError: if there are too few, one that cannot be read, or keys that go with a single log alone.
    """
    if config.test:
        raise ValueError("test=... goes with one log: leave it out, or diagnose the dives one by one")
    found = find_logs(config)
    healthy = found["healthy"]
    own = {realpath(path) for path in healthy}
    dives = [path for path in found["log"] if realpath(path) not in own]  # of a link to itself, too
    if all(begun(path) for path in dives):
        dives.sort(key=begun)
    reference = len(healthy) or int(config.reference)
    if not healthy and reference < 1:
        raise ValueError(f"reference is {reference}: give 1 dive or more that is known to be sound, or healthy=[...]")
    paths = (*healthy, *dives)
    if len(paths) <= reference:
        raise ValueError(
            f"{counted(len(paths), 'dive')}, and the reference is {reference} of them: give more, or "
            "fewer as reference=1"
        )
    return Planned(paths, tuple(begun(path) for path in paths), reference, no_logs(config))


def begun(path: Path) -> str:
    """When a dive began, as the name of its file says; empty where it does not."""
    found = _DATE.search(path.name)
    if found is None:
        return ""
    numbers = [int(part) for part in found.groups() if part is not None]
    try:
        moment = datetime(*numbers)  # pyright: ignore[reportArgumentType]  # three to six numbers
    except ValueError:
        return ""
    return moment.isoformat(sep=" ", timespec="minutes") if len(numbers) > 3 else moment.date().isoformat()
