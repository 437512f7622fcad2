"""What people add to a file: modes to take, parameters that it lacks, which vehicle of several."""

import math
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from auv_torchrl.flightlog.findings import Finding, FlightLogError
from auv_torchrl.flightlog.streams.mapping import read_mapping
from auv_torchrl.flightlog.streams.parameters import is_name, read_parameters
from auv_torchrl.flightlog.streams.stream import ReadOptions
from auv_torchrl.text import number, whole

_MOST = 3.4e38  # what a parameter can be: ArduPilot has them as float32
_MOST_BYTES = 4 << 20  # of a file of parameters; a vehicle has some thousand


def read_options(modes: Iterable[str] = (), params: Any = None, system: Any = None, mapping: Any = None) -> ReadOptions:
    """Options as commands are given them; ``params`` is a file, or values by name; ``mapping`` is a file.

    Raises:
        FlightLogError: for a file of parameters or a mapping that cannot be read, or a value that is no number.
    """
    chosen = None if system is None else whole(str(system))
    if system is not None and (chosen is None or chosen < 0):
        raise FlightLogError(f"system={system} is no number of a vehicle: give system=1")
    named = tuple(str(mode).upper() for mode in modes)
    values, findings = _parameters(params)
    return ReadOptions(named, values, chosen, read_mapping(str(mapping)) if mapping else (), findings)


def _parameters(given: Any) -> tuple[dict[str, float], tuple[Finding, ...]]:
    if given is None or given == "":
        return {}, ()
    if isinstance(given, str) and given.lstrip().startswith("{"):
        given = _mapping(given)
    if isinstance(given, Mapping):
        values = [(str(name).upper(), _number(str(name), value)) for name, value in given.items()]
        return read_parameters("params=", values)
    path = Path(str(given))
    return read_parameters(path.name, _from_file(path))


def _mapping(text: str) -> Any:
    try:
        return yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise FlightLogError(f"params={text} cannot be read: give a file, or params={{MOT_1_DIRECTION: 1}}") from error


def _number(name: str, value: Any) -> float:
    given = number(value) if isinstance(value, str) else value
    if isinstance(given, bool) or not isinstance(given, int | float):
        raise FlightLogError(f"params: {name} is {str(value)[:40]!r}, which is no number: give one such as 1 or -0.5")
    return float(given) if abs(given) <= _MOST else math.copysign(math.inf, given)


def _from_file(path: Path) -> list[tuple[str, float]]:
    """Parameters as QGroundControl, Mission Planner and MAVProxy save them."""
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise FlightLogError(f"{path} is too large for a file of parameters: give one that a ground station saved")
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise FlightLogError(f"params={path}: {error.strerror or error}: give a file of parameters") from error
    found = []
    for line in text.split("\n"):
        words = re.split(r"[\s,]+", line.partition("#")[0].strip())
        if len(words) >= 4 and None not in (whole(words[0]), whole(words[1])):  # system, component, name, value, type
            words = words[2:]
        if len(words) >= 2 and is_name(words[0]):
            found.append((words[0], _number(words[0], words[1])))
    if not found:
        raise FlightLogError(f"{path} holds no parameters: save them from a ground station, a name and a value a line")
    return found
