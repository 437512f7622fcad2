"""Libraries that only some formats need, with one clear line where one is missing."""

from importlib import import_module
from typing import Any

from auv_torchrl.flightlog.findings import FlightLogError


def library(module: str, needed_for: str) -> Any:
    """A module of an optional library.

    Raises:
        FlightLogError: if it is not installed, saying how to.
    """
    try:
        return import_module(module)
    except ImportError as error:
        name = module.partition(".")[0]
        raise FlightLogError(
            f"{needed_for} is read by {name}, which is not installed: pip install 'auv_torchrl[logs]'"
        ) from error
