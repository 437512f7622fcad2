"""The logs that a config names, found before anything that takes long is loaded."""

import re
from collections.abc import Iterator
from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from auv_torchrl.flightlog.findings import Finding, FlightLogError, Severity
from auv_torchrl.flightlog.readers import READERS, TABLES, choose_reader, is_log_name
from auv_torchrl.paths import EXAMPLE_LOG
from auv_torchrl.text import whole

KINDS = ("log", "healthy", "test")
EXAMPLE = "example"  # log=example is the log that comes with the package, unless there is a file of that name
BESIDES = "besides_logs"  # code of the finding about what a folder of dives holds besides
_NAMED = 5  # entries of a folder that are no logs, by name
NO_LOG = f"no log: give log=flight.csv, or log={EXAMPLE} for the one that comes with the package"


def find_logs(config: DictConfig) -> dict[str, tuple[Path, ...]]:
    """By key of ``conf/diagnose.yaml``, the files that it names; those in a folder of dives are not looked at yet.

    Raises:
        ValueError: if there is no log, or one that is named cannot be read, is empty, or is not what its name says.
    """
    found = {kind: logs_of(config, kind) for kind in KINDS}
    if not found["log"]:
        raise ValueError(NO_LOG)
    dives = {path for folder in _folders(config) for path in _inside(folder)}
    for path in (path for paths in found.values() for path in paths if path not in dives):
        choose_reader(path, READERS)
    return found


def no_logs(config: DictConfig) -> tuple[Finding, ...]:
    """What folders of dives hold besides logs, for each folder in one finding."""
    return tuple(finding for folder in _folders(config) for finding in _besides(folder))


def _besides(folder: Path) -> Iterator[Finding]:
    besides = {path: why for path in _entries(folder) if (why := _why_no_log(path))}
    if besides:
        named = ", ".join(f"{path.name} ({why})" for path, why in sorted(besides.items())[:_NAMED])
        more = f" and {len(besides) - _NAMED} more" if len(besides) > _NAMED else ""
        sentence = f"of the folder {folder.name}, {named}{more} {'are' if len(besides) > 1 else 'is'} left out"
        remedy = f"Logs are files that end in {', '.join(_suffixes())}, and bags of ROS 2"
        yield Finding(Severity.INFO, BESIDES, sentence, remedy)


def _folders(config: DictConfig) -> list[Path]:
    """The folders of dives."""
    return [path for path in map(_shipped, names(config, "log")) if _is_folder(path)]


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
    logs = [path for path in _entries(folder) if not _why_no_log(path)]
    if not logs:
        wanted = ", ".join(_suffixes())
        raise FlightLogError(f"the directory {folder} holds no log ({wanted}): name a log, or a folder of dives")
    yield from sorted(logs, key=_as_counted)


def _entries(folder: Path) -> list[Path]:
    return [path for path in folder.iterdir() if not path.name.startswith(".")]


def _suffixes() -> list[str]:
    return sorted({suffix for reader in READERS.values() for suffix in reader.suffixes} | set(TABLES))


def _why_no_log(path: Path) -> str:
    """Why an entry of a folder is not taken for a log; empty where it is, readable or not."""
    try:
        if path.is_dir():
            return "a folder" if _is_folder(path) else ""
    except OSError as error:
        return error.strerror or str(error)
    return "" if is_log_name(path.name) else "not named as a log"


def _as_counted(path: Path) -> list[tuple[int, str]]:
    """Dive 9 comes before dive 10."""
    parts = ((whole(part), part) for part in re.split(r"([0-9]+)", path.name))
    return [(-1, part.lower()) if number is None else (number, "") for number, part in parts]


def names(config: DictConfig, key: str) -> tuple[str, ...]:
    """The entries of a key that takes one or several; none where it is missing, null or empty."""
    if OmegaConf.is_missing(config, key) or config[key] is None:
        return ()
    value = config[key]
    return tuple(filter(None, map(str, value if OmegaConf.is_config(value) else [value])))


def _shipped(name: str) -> Path:
    return EXAMPLE_LOG if name == EXAMPLE and not Path(name).exists() else Path(name)
