"""The logs that a config names, found before anything that takes long is loaded."""

from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from auv_torchrl.flightlog.readers import READERS, choose_reader
from auv_torchrl.paths import EXAMPLE_LOG

KINDS = ("log", "healthy", "test")
EXAMPLE = "example"  # log=example is the log that comes with the package, unless there is a file of that name
NO_LOG = f"no log: give log=flight.csv, or log={EXAMPLE} for the one that comes with the package"


def find_logs(config: DictConfig) -> dict[str, tuple[Path, ...]]:
    """By key of ``conf/diagnose.yaml``, the files that it names.

    Raises:
        ValueError: if there is no log, or a file that cannot be read, is empty, or is not what its name says.
    """
    found = {kind: tuple(_shipped(name) for name in names(config, kind)) for kind in KINDS}
    if not found["log"]:
        raise ValueError(NO_LOG)
    for path in (path for paths in found.values() for path in paths):
        choose_reader(path, READERS)
    return found


def names(config: DictConfig, key: str) -> tuple[str, ...]:
    """The entries of a key that takes one or several; none where it is missing or null."""
    if OmegaConf.is_missing(config, key) or config[key] is None:
        return ()
    value = config[key]
    return tuple(map(str, value)) if OmegaConf.is_config(value) else (str(value),)


def _shipped(name: str) -> Path:
    return EXAMPLE_LOG if name == EXAMPLE and not Path(name).exists() else Path(name)
