"""The logs that a config names, found before anything that takes long is loaded."""

import re
from collections.abc import Iterator
from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from auv_torchrl.flightlog.findings import FlightLogError
from auv_torchrl.flightlog.readers import READERS, choose_reader
from auv_torchrl.paths import EXAMPLE_LOG

KINDS = ("log", "healthy", "test")
EXAMPLE = "example"  # log=example is the log that comes with the package, unless there is a file of that name
TABLES = (".csv", ".parquet")  # what a folder of dives may hold beside the formats of vehicles
NO_LOG = f"no log: give log=flight.csv, or log={EXAMPLE} for the one that comes with the package"


def find_logs(config: DictConfig) -> dict[str, tuple[Path, ...]]:
    """By key of ``conf/diagnose.yaml``, the files that it names.

    Raises:
        ValueError: if there is no log, or a file that cannot be read, is empty, or is not what its name says.
    """
    found = {kind: logs_of(config, kind) for kind in KINDS}
    if not found["log"]:
        raise ValueError(NO_LOG)
    for path in (path for paths in found.values() for path in paths):
        choose_reader(path, READERS)
    return found


def is_series(config: DictConfig) -> bool:
    """Whether the logs are dives of their own rather than one log: as is asked for, or because a folder is named."""
    return bool(config.dives) or any(_is_folder(_shipped(name)) for name in names(config, "log"))


def logs_of(config: DictConfig, kind: str = "log") -> tuple[Path, ...]:
    """The files under a key, those of a folder in the order of their names.

    Raises:
        ValueError: for a folder without logs.
    """
    named = (_shipped(name) for name in names(config, kind))
    return tuple(path for name in named for path in (_inside(name) if _is_folder(name) else [name]))


def _is_folder(path: Path) -> bool:
    """Whether it holds logs rather than being one, as a bag of ROS 2 is."""
    return path.is_dir() and not any(reader.folders(path) for reader in READERS.values())


def _inside(folder: Path) -> Iterator[Path]:
    known = {suffix for reader in READERS.values() for suffix in reader.suffixes} | set(TABLES)
    found = [path for path in folder.iterdir() if not path.name.startswith(".")]
    logs = [p for p in found if (p.suffix.lower() in known if p.is_file() else not _is_folder(p))]
    if not logs:
        wanted = ", ".join(sorted(known))
        raise FlightLogError(f"the directory {folder} holds no log ({wanted}): name a log, or a folder of dives")
    yield from sorted(logs, key=_as_counted)


def _as_counted(path: Path) -> list[tuple[int, str]]:
    """Dive 9 comes before dive 10."""
    parts = re.split(r"([0-9]+)", path.name)
    return [(int(part), "") if part.isascii() and part.isdigit() else (-1, part.lower()) for part in parts]


def names(config: DictConfig, key: str) -> tuple[str, ...]:
    """The entries of a key that takes one or several; none where it is missing or null."""
    if OmegaConf.is_missing(config, key) or config[key] is None:
        return ()
    value = config[key]
    return tuple(map(str, value)) if OmegaConf.is_config(value) else (str(value),)


def _shipped(name: str) -> Path:
    return EXAMPLE_LOG if name == EXAMPLE and not Path(name).exists() else Path(name)
