"""Libraries that are there where an extra was installed."""

from importlib import import_module
from typing import Any


class MissingLibrary(ValueError):
    """An optional library is not installed; the message says how to get it."""


def library(module: str, needed_for: str, extra: str) -> Any:
    """A module of an optional library.

    Args:
        module: its name.
        needed_for: what needs it.
        extra: of this package, that brings it.

    Raises:
        MissingLibrary: if it is not installed.
    """
    try:
        return import_module(module)
    except ImportError as error:
        name = module.partition(".")[0]
        raise MissingLibrary(
            f"{needed_for} needs {name}, which is not installed: pip install 'auv_torchrl[{extra}]'"
        ) from error
