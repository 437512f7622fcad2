"""``contract.json``: what the files of an export take and give, in which units and frames, how often, and within what.

It is read without torch, by whoever flies.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from auv_torchrl.files import write_text, write_whole
from auv_torchrl.vehicle.fields import DEGREES_OF_FREEDOM

CONTRACT, FORMAT, VERSION = "contract.json", "auv_torchrl export", 1
FRAMES = {
    "earth": "NED: x north, y east, z down, m",
    "body": "FRD: x front, y right, z down",
    "quaternion": "w, x, y, z; turns vectors of the body into those of the earth",
    "velocity": "surge, sway, heave in m/s, roll, pitch, yaw rate in rad/s, along the axes of the body, over ground",
}
_UNITS = {"error_x": "m", "error_y": "m", "error_z": "m", "yaw": "rad/s",
          "turning_error": "1"}  # of a turn_rate, or of 1 rad/s  # fmt: skip
_BY_ENDING = {"_speed": "m/s", "_speed_error": "m/s", "_rate": "rad/s", "_sin": "1", "_cos": "1"}
_BY_BEGINNING = {"near_": "1", "far_": "1", "down_": "1", "surge_in_": "m/s", "sway_in_": "m/s", "heave_in_": "m/s",
                 "yaw_in_": "rad/s"}  # fmt: skip
TILT = ("down_x", "down_y")  # of the motion that maps read, where a task has any tilt


class ContractError(ValueError):
    """An export that cannot be flown; the message says why."""


def motion_name(axis: str) -> str:
    """What the contract calls the speed along a degree of freedom."""
    return f"{axis}_{'speed' if DEGREES_OF_FREEDOM.index(axis) < 3 else 'rate'}"


def unit_of(observation: str) -> str | None:
    """The unit of an entry of an observation by its name; None for one of a task of one's own, which has to say it."""
    found = [unit for ending, unit in _BY_ENDING.items() if observation.endswith(ending)]
    found += [unit for beginning, unit in _BY_BEGINNING.items() if observation.startswith(beginning)]
    return _UNITS.get(observation, found[0] if found else None)


def entries(names: Mapping[str, str | None], low: float | None = None, high: float | None = None) -> list[Any]:
    """What the columns of an array are: name, unit and, where there are any, limits."""
    limits = {} if low is None or high is None else {"low": low, "high": high}
    return [{"name": name, "unit": unit, **limits} for name, unit in names.items()]


def write_export(folder: Path, files: Mapping[str, bytes], about: Mapping[str, Any]) -> None:
    """Write ``<name>.onnx`` for each file, and then the contract, which has their digests.

    Args:
        folder: that is there.
        files: by name.
        about: what the contract says; its ``files`` say by name what goes in and comes out.
    """
    content = {"format": FORMAT, "version": VERSION, **about}
    for name, data in files.items():
        write_whole(folder / f"{name}.onnx", data)
        content["files"][name] = {"file": f"{name}.onnx", "sha256": _digest(data), **content["files"][name]}
    write_text(folder / CONTRACT, json.dumps(content, indent=2, allow_nan=False) + "\n")


def read_export(folder: Path) -> tuple[dict[str, Any], dict[str, bytes]]:
    """The contract, and the files by name.

    Raises:
        ContractError: for a folder without one, of another version, or whose files are not those that it speaks of.
    """
    path = folder / CONTRACT
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ContractError(
            f"{path} is no contract ({error}): give the folder that auv-export policy=... wrote"
        ) from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise ContractError(f"{path} is no contract of {FORMAT}: give the folder that auv-export policy=... wrote")
    if content["version"] != VERSION:
        raise ContractError(f"{path} is of version {content['version']}, this program reads {VERSION}: export it anew")
    files = {}
    for name, entry in content["files"].items():
        try:
            files[name] = (folder / entry["file"]).read_bytes()
        except OSError as error:
            raise ContractError(f"{folder} is incomplete ({error}): export it anew") from error
        if _digest(files[name]) != entry["sha256"]:
            raise ContractError(f"{folder / entry['file']} is not the file of its contract: export it anew")
    return content, files


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
