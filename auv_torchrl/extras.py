"""Libraries that are there where an extra of this package was installed."""

from collections.abc import Iterable
from importlib import import_module
from importlib.util import find_spec
from typing import Any


class MissingLibrary(ValueError):
    """An optional library is not installed; the message says how to get it."""


def library(module: str, clause: str, extra: str, error: type[ValueError] = MissingLibrary) -> Any:
    """A module of an optional library.

    Args:
        module: its name.
        clause: what asks for it, with a verb: "flying an export needs".
        extra: of this package, that brings it.
        error: raised if it is not installed.
    """
    try:
        return import_module(module)
    except ImportError as cause:
        name = module.partition(".")[0]
        raise error(f"{clause} {name}, which is not installed: {command(extra)}") from cause


def require(modules: Iterable[str], clause: str, extra: str) -> None:
    """Refuse to go on where an optional library is not installed; none is imported.

    Args:
        modules: names of its modules.
        clause: what asks for it, with a verb: "auv-train needs".
        extra: of this package, that brings them.

    Raises:
        MissingLibrary: naming the first, and how to get it.
    """
    for module in modules:
        try:
            found = find_spec(module) is not None
        except ImportError:
            found = False
        if not found:
            raise MissingLibrary(f"{clause} {module}, which is not installed: {command(extra)}")


def is_installed(*modules: str) -> bool:
    """Whether optional libraries are there, all of them; they are imported."""
    try:
        for module in modules:
            import_module(module)
    except ImportError:
        return False
    return True


def command(extra: str) -> str:
    """What brings the libraries of an extra of this package."""
    return f"pip install 'auv_torchrl[{extra}]'"
