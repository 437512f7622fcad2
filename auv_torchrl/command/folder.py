"""The output folder of a run: claimed before anything is written, continued where a run was broken off, used once.

``run.json`` says what runs there and since when, and ``finished`` in it when it ended; ``config.yaml`` its settings. A
process that works in a folder holds the lock on ``.lock`` in it, which the system releases however the process ends.
"""

import errno
import json
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from auv_torchrl import __version__
from auv_torchrl.command.errors import BadInput
from auv_torchrl.files import write_text

RUN, CONFIG, LOCK = "run.json", "config.yaml", ".lock"
RECORDED_PACKAGES = (
    "torch", "torchrl", "tensordict", "mujoco", "dm-control", "numpy", "scipy", "llvmlite", "rerun-sdk",
)  # fmt: skip
_SHOWN = 3  # files or settings that a message quotes
_NOT_OURS_TO_FIX = {
    errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOTDIR, errno.EEXIST, errno.ENOENT, errno.ENOSPC, errno.EDQUOT,
    errno.ENAMETOOLONG,
}  # fmt: skip


@dataclass(frozen=True)
class _Held:
    """A folder that this process works in."""

    lock: FileLock
    goes_on: bool


_held: dict[Path, _Held] = {}


def claim_folder(
    folder: Path, command: str = "", config: str = "", overrides: list[str] | None = None, ours: tuple[str, ...] = ()
) -> None:
    """Make an output folder, or go on in one where the same run was broken off.

    Args:
        folder: of the run.
        command: its name.
        config: its resolved settings as YAML; empty for none, as for a whole sweep.
        overrides: of the command line; they are compared where there is no config.
        ours: files that are there because the run has begun.

    Raises:
        BadInput: if it holds anything else, is in use, or cannot be written.
    """
    folder = folder.absolute()
    overrides = [given for given in overrides or [] if not given.startswith("output=")]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _refuse_foreign(folder, command, ours)
        lock = _lock(folder)
    except OSError as error:
        if error.errno not in _NOT_OURS_TO_FIX:
            raise
        raise BadInput(_cannot_write(folder, error)) from error
    try:
        before = _refuse_foreign(folder, command, ours)
        if before is not None:
            _refuse_other_settings(folder, config, overrides, before)
        write_text(folder / RUN, json.dumps(_about(command, overrides, before), indent=2) + "\n")
        if config:
            write_text(folder / CONFIG, config)
    except BaseException as error:
        _unlock(folder, lock)
        if isinstance(error, OSError) and error.errno in _NOT_OURS_TO_FIX:
            raise BadInput(_cannot_write(folder, error)) from error
        raise
    _held[folder] = _Held(lock, before is not None)


def is_finished(folder: Path) -> bool:
    """Whether a run of ours ended in this folder."""
    about = _read(folder)
    return about is not None and bool(about.get("finished"))


def finish(folder: Path) -> None:
    """Write down that the run in a folder that this process holds is over: it is never overwritten from now on."""
    folder = folder.absolute()
    if folder not in _held:
        return
    about = {**(_read(folder) or {}), "finished": _now()}
    write_text(folder / RUN, json.dumps(about, indent=2) + "\n")


def leave(folder: Path | None = None) -> None:
    """Release the folder, or all that this process holds."""
    for held in [folder.absolute()] if folder is not None else list(_held):
        if held in _held:
            _unlock(held, _held.pop(held).lock)


def discard_start(folder: Path, command: str) -> None:
    """Remove a folder that holds nothing but the start of a refused run, so that the mended command can use it."""
    leave(folder)
    entries = list(folder.iterdir()) if folder.is_dir() else []
    if {entry.name for entry in entries} <= {RUN, CONFIG, LOCK, f"{command}.log"} and not is_finished(folder):
        for entry in entries:
            entry.unlink()
        folder.rmdir()


def goes_on(folder: Path) -> bool:
    """Whether this process holds the folder and an earlier one began there."""
    held = _held.get(folder.absolute())
    return held is not None and held.goes_on


def _refuse_foreign(folder: Path, command: str, ours: tuple[str, ...]) -> dict[str, Any] | None:
    """What ``run.json`` says of an unfinished run; None where the folder is empty."""
    used = sorted({entry.name for entry in folder.iterdir()} - {LOCK, *ours})
    about = _read(folder)
    if about is not None and about.get("command") == command and _is_unfinished(about):
        return about
    if not used:
        return None
    finished = "by a run that has finished " if about is not None and about.get("finished") else ""
    raise BadInput(
        f"the output folder {folder} is already used {finished}"
        f"(it holds {', '.join(used[:_SHOWN])}{', ...' * (len(used) > _SHOWN)}): "
        "give another one with output=DIR, or delete it"
    )


def _is_unfinished(about: Mapping[str, Any]) -> bool:
    """Whether :func:`_about` wrote this, and the run has not ended."""
    lists = about.get("overrides"), about.get("continued", [])
    return all(isinstance(entry, list) for entry in lists) and "started" in about and about.get("finished", "") is None


def _refuse_other_settings(folder: Path, config: str, overrides: list[str], before: Mapping[str, Any]) -> None:
    if config:
        kept = folder / CONFIG
        try:
            there = _flat(OmegaConf.load(kept)) if kept.is_file() else {}
        except (ValueError, OSError, YAMLError, OmegaConfBaseException) as error:
            raise BadInput(
                f"the output folder {folder} is already used by an unfinished run whose settings, {CONFIG}, cannot be "
                f"read ({type(error).__name__}): give another folder with output=DIR, or delete it"
            ) from error
        here = _flat(OmegaConf.create(config)) if there else {}
        changed = [key for key in sorted({*there, *here}) if key != "output" and there.get(key) != here.get(key)]
        differ = [f"{key} is {_value(there, key)} there and {_value(here, key)} here" for key in changed]
    else:
        differ = [f"{given} is given only there" for given in before["overrides"] if given not in overrides]
        differ += [f"{given} is given only here" for given in overrides if given not in before["overrides"]]
    if differ:
        raise BadInput(
            f"the output folder {folder} is already used by an unfinished run with other settings "
            f"({'; '.join(differ[:_SHOWN])}{'; ...' * (len(differ) > _SHOWN)}): give the same settings to go on, "
            "another folder with output=DIR, or delete it"
        )


def _flat(node: Any, prefix: str = "") -> dict[str, Any]:
    content = OmegaConf.to_container(node) if OmegaConf.is_config(node) else node
    if not isinstance(content, dict) or not content:
        return {prefix: content}
    found: dict[str, Any] = {}
    for key, value in content.items():
        found |= _flat(value, f"{prefix}.{key}" if prefix else str(key))
    return found


def _value(settings: Mapping[str, Any], key: str) -> str:
    return repr(settings[key]) if key in settings else "not set"


def _about(command: str, overrides: list[str], before: Mapping[str, Any] | None) -> dict[str, Any]:
    about = {
        "version": __version__,
        "command": command,
        "overrides": overrides,
        "started": before["started"] if before else _now(),
        "finished": None,
        "python": platform.python_version(),
        "packages": _versions(),
    }
    return {**about, "continued": [*before.get("continued", []), _now()]} if before else about


def _read(folder: Path) -> dict[str, Any] | None:
    """``run.json`` of the folder; None if there is none that a run of ours wrote."""
    try:
        about = json.loads((folder / RUN).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return about if isinstance(about, dict) else None


def _lock(folder: Path) -> FileLock:
    lock = FileLock(folder / LOCK, thread_local=False)
    try:
        lock.acquire(blocking=False)
    except Timeout as error:
        raise BadInput(
            f"the output folder {folder} is already used by a run that is still going: wait for it, or give another "
            "one with output=DIR"
        ) from error
    return lock


def _unlock(folder: Path, lock: FileLock) -> None:
    (folder / LOCK).unlink(missing_ok=True)
    lock.release()


def _cannot_write(folder: Path, error: OSError) -> str:
    return f"cannot write to {folder} ({error.strerror}): give a folder you may write with output=DIR"


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _versions() -> dict[str, str]:
    """Those of the packages that matter to results and are installed."""
    found = {}
    for name in RECORDED_PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:  # of an extra
            continue
    return found
