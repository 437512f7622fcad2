"""What people add to a file: modes to take, parameters that it lacks, which vehicle of several."""

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from auv_torchrl.flightlog.findings import FlightLogError
from auv_torchrl.flightlog.streams.stream import ReadOptions

_NAME = re.compile(r"[A-Z][A-Z0-9_]{1,15}")
_MOST_BYTES = 4 << 20  # of a file of parameters; a vehicle has some thousand


def read_options(modes: Iterable[str] = (), params: Any = None, system: Any = None) -> ReadOptions:
    """Options as commands are given them; ``params`` is a file, or values by name.

    Raises:
        FlightLogError: for a file of parameters that cannot be read, or a value that is no number.
    """
    if system is not None and not str(system).isdigit():
        raise FlightLogError(f"system={system} is no number of a vehicle: give system=1")
    named = tuple(str(mode).upper() for mode in modes)
    return ReadOptions(named, _parameters(params), None if system is None else int(system))


def _parameters(given: Any) -> dict[str, float]:
    if given is None or given == "":
        return {}
    if isinstance(given, str) and given.lstrip().startswith("{"):
        given = _mapping(given)
    if isinstance(given, Mapping):
        return {str(name).upper(): _number(str(name), value) for name, value in given.items()}
    return _from_file(Path(str(given)))


def _mapping(text: str) -> Any:
    try:
        return yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise FlightLogError(f"params={text} cannot be read: give a file, or params={{MOT_1_DIRECTION: 1}}") from error


def _number(name: str, value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError) as error:
        raise FlightLogError(f"params: {name} is {value!r}, which is no number") from error


def _from_file(path: Path) -> dict[str, float]:
    """Parameters as QGroundControl, Mission Planner and MAVProxy save them."""
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise FlightLogError(f"{path} is too large for a file of parameters: give one that a ground station saved")
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise FlightLogError(f"params={path}: {error.strerror or error}: give a file of parameters") from error
    found = {}
    for line in text.splitlines():
        words = re.split(r"[\s,]+", line.partition("#")[0].strip())
        if len(words) >= 4 and words[0].isdigit() and words[1].isdigit():  # system, component, name, value, type
            words = words[2:]
        if len(words) >= 2 and _NAME.fullmatch(words[0]):
            found[words[0]] = _number(words[0], words[1])
    if not found:
        raise FlightLogError(f"{path} holds no parameters: save them from a ground station, a name and a value a line")
    return found
