"""Where the configuration lies, in a checkout and in an installed package."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent
PROJECT = _PACKAGE.parent  # of a checkout; the wheel takes what package code reads into the package
CONF = next((folder for folder in (_PACKAGE / "conf", PROJECT / "conf") if folder.is_dir()), PROJECT / "conf")
EXAMPLE_LOG = CONF.parent / "examples" / "flight.csv"


def config_names(group: str) -> list[str]:
    """The names that a configuration group offers, e.g. ``config_names("vehicle")``."""
    return sorted(path.stem for path in (CONF / group).glob("*.yaml") if path.is_file())


def config_path(group: str, name: str) -> Path:
    """The YAML file ``conf/<group>/<name>.yaml``.

    Raises:
        FileNotFoundError: if the group has no such entry; the message lists those there are.
    """
    path = CONF / group / f"{name}.yaml"
    if not path.is_file():
        raise FileNotFoundError(
            f"no {group} named {name!r}: there are {', '.join(config_names(group))} (in {CONF / group})"
        )
    return path
