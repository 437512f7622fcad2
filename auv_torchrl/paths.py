"""Where the configuration lies: in a checkout, in an installed package, and in a folder of one's own; and the cache."""

import os
import sys
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent
PROJECT = _PACKAGE.parent  # of a checkout; the wheel takes what package code reads into the package
CONF = next((folder for folder in (_PACKAGE / "conf", PROJECT / "conf") if folder.is_dir()), PROJECT / "conf")
EXAMPLE_LOG = CONF.parent / "examples" / "flight.csv"
OWN = "AUV_CONF"  # the environment variable that names a folder of one's own
PLAIN = ("vehicle", "scenario", "randomization")  # groups of physical numbers, which depend on nothing outside of them
ENDINGS = (".yaml", ".yml")
SCHEMA = "_schema"  # ends the names of schemas, which stand beside the options of a group


def own_folder() -> Path | None:
    """The folder that ``AUV_CONF`` names, with groups as in ``conf``, and Python in ``effects`` ...; None for none."""
    given = os.environ.get(OWN)
    return Path(given).expanduser().absolute() if given else None


def cache_folder() -> Path:
    """Where programs of one user keep what they can work out again.

    Raises:
        OSError: for a user who has no home folder, and for whom nothing names another.
    """
    if sys.platform == "win32" and (named := os.environ.get("LOCALAPPDATA")):
        return Path(named) / "auv_torchrl"
    if sys.platform not in ("win32", "darwin") and (named := os.environ.get("XDG_CACHE_HOME")):
        return Path(named) / "auv_torchrl"
    try:
        home = Path.home()
    except RuntimeError as error:
        raise OSError("this user has no home folder, give one with HOME") from error
    inside = {"win32": "AppData/Local", "darwin": "Library/Caches"}.get(sys.platform, ".cache")
    return home / inside / "auv_torchrl"


def config_folders(group: str) -> list[Path]:
    """Where the entries of a configuration group are looked for."""
    own = own_folder()
    return [CONF / group] if own is None else [CONF / group, own / group]


def config_names(group: str) -> list[str]:
    """The names that a configuration group offers, e.g. ``config_names("vehicle")``."""
    return sorted({path.stem for folder in config_folders(group) for path in folder.glob("*.yaml") if path.is_file()})


def config_path(group: str, name: str) -> Path:
    """The YAML file of an entry: ``conf/<group>/<name>.yaml``, or the same in one's own folder.

    Raises:
        FileNotFoundError: if the group has no such entry; the message lists those there are.
        ValueError: if both folders have one.
    """
    found = [path for folder in config_folders(group) if (path := folder / f"{name}.yaml").is_file()]
    if len(found) > 1:
        raise ValueError(f"{found[1]} has the name of a {group} of the package: rename it")
    if not found:
        where = " and ".join(map(str, config_folders(group)))
        raise FileNotFoundError(f"no {group} named {name!r}: there are {', '.join(config_names(group))} (in {where})")
    return found[0]
