"""Where the project keeps its configuration."""

from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1]
CONF = PROJECT / "conf"


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
