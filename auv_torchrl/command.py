"""What every command of the project shares: errors of one line, and an output folder that is used once."""

import difflib
import errno
import functools
import json
import logging
import os
import platform
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, NoReturn

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from hydra.experimental.callback import Callback
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from auv_torchrl import __version__
from auv_torchrl.config_source import check_config_files
from auv_torchrl.paths import CONF, config_names

BAD_INPUT = 2  # exit code, as for a wrong command line
INTERRUPTED = 130  # 128 + SIGINT
RECORDED_PACKAGES = ("torch", "torchrl", "tensordict", "mujoco", "dm-control", "numpy", "rerun-sdk")
_NOT_OURS_TO_FIX = {errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOTDIR, errno.EEXIST, errno.ENOENT, errno.ENOSPC}

log = logging.getLogger(__name__)


class BadInput(Exception):
    """Something that the user gave is wrong; the message is one line that says what to do."""


CHECKS: tuple[type[Exception], ...] = (ValueError, KeyError, FileNotFoundError, FileExistsError)


@contextmanager
def checking_input(errors: tuple[type[Exception], ...] = CHECKS) -> Iterator[None]:
    """Turn ``errors`` of functions that check what the user gave into :class:`BadInput`.

    Only for such calls: elsewhere a ``ValueError`` is a defect of the program and keeps its traceback.
    """
    try:
        yield
    except errors as error:
        message = error.args[0] if isinstance(error, KeyError) else error
        raise BadInput(_one_line(str(message))) from error


def command(config_name: str) -> Callable[[Callable[[DictConfig], None]], Callable[[], None]]:
    """``hydra.main`` on ``conf/<config_name>.yaml`` that ends with one line and exit code 2 on bad input."""

    def decorate(task: Callable[[DictConfig], None]) -> Callable[[], None]:
        @functools.wraps(task)
        def job(config: DictConfig) -> None:
            try:
                task(config)
            except BadInput as error:
                if HydraConfig.get().mode is RunMode.MULTIRUN:
                    raise  # the other jobs of the sweep go on; Hydra reports this one when they are done
                release_folder(Path(HydraConfig.get().runtime.output_dir), config_name)
                _fail(config_name, str(error))

        hydra_main = hydra.main(version_base="1.3", config_path=str(CONF), config_name=config_name)(job)

        def entry() -> None:
            os.environ.setdefault("HYDRA_FULL_ERROR", "1")  # Hydra hands its errors on instead of printing them
            check_config_files()
            try:
                hydra_main()
            except (HydraException, OmegaConfBaseException) as error:
                _fail(config_name, _explain(config_name, error))
            except BadInput as error:
                _fail(config_name, str(error))
            except KeyboardInterrupt as interrupt:
                sys.stderr.write(f"{config_name}: interrupted {interrupt}".rstrip() + "\n")
                sys.exit(INTERRUPTED)

        return entry

    return decorate


def _fail(config_name: str, message: str) -> NoReturn:
    sys.stderr.write(f"{config_name}: {message}\n")
    sys.exit(BAD_INPUT)


def _one_line(message: str) -> str:
    return " ".join(message.split())


def _explain(config_name: str, error: Exception) -> str:
    """One line out of an error of Hydra or OmegaConf, with the keys there are."""
    text = str(error).split("Config search path")[0].split("\nSee https")[0]
    if missing := re.search(r"Could not override '([^']+)'\.\s*To append", text):
        return _unknown_key(config_name, missing[1])
    if absent := re.search(r"Could not (?:find|load) '([^']+)/([^/']+)'", text):
        return f"no {absent[1]} named {absent[2]!r}: there are {', '.join(config_names(absent[1]))}"
    cause = error.__cause__
    reason = str(cause).split("\n    full_key")[0] if cause is not None else ""
    return _one_line(f"{text.strip()}: {reason}" if reason and reason not in text else text)


def _unknown_key(config_name: str, key: str) -> str:
    with hydra.initialize_config_dir(version_base="1.3", config_dir=str(CONF)):
        config = hydra.compose(config_name)
    parent, _, name = key.rpartition(".")
    while parent and not isinstance(OmegaConf.select(config, parent), DictConfig):
        parent, _, name = parent.rpartition(".")
    node = OmegaConf.select(config, parent) if parent else config
    known = sorted(str(k) for k in node)
    close = difflib.get_close_matches(name, known, n=1)
    hint = f" (did you mean {close[0]}?)" if close else ""
    where = f" in {parent}" if parent else ""
    return f"no config key {name!r}{where}{hint}: there are {', '.join(known)}"


def claim_folder(folder: Path) -> None:
    """Make an output folder.

    Raises:
        BadInput: if it is already used or cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        used = sorted(entry.name for entry in folder.iterdir())
        if not used:
            (folder / "run.json").touch(exist_ok=False)
    except OSError as error:
        if error.errno not in _NOT_OURS_TO_FIX:
            raise
        raise BadInput(
            f"cannot write to {folder} ({error.strerror}): give a folder you may write with output=DIR"
        ) from error
    if used:
        raise BadInput(
            f"the output folder {folder} is already used (it holds {', '.join(used[:3])}{', ...' * (len(used) > 3)}): "
            "give another one with output=DIR, or delete it"
        )


def release_folder(folder: Path, job_name: str) -> None:
    """Remove a folder that holds nothing but the start of a refused job, so that the mended command can use it."""
    entries = list(folder.iterdir())
    if {entry.name for entry in entries} <= {"run.json", "config.yaml", f"{job_name}.log"}:
        for entry in entries:
            entry.unlink()
        folder.rmdir()


class OutputFolder(Callback):
    """Refuses a used output folder before anything is written, then records how each job was started."""

    def on_run_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Claim the folder of a single run."""
        self._claim(config, config.hydra.run.dir)

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Claim the folder of a sweep."""
        self._claim(config, config.hydra.sweep.dir)

    def on_job_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Write ``config.yaml`` (resolved) and ``run.json`` (versions, overrides) into the job's folder."""
        folder = Path(config.hydra.runtime.output_dir)
        task = OmegaConf.masked_copy(config, [str(key) for key in config if key != "hydra"])
        (folder / "config.yaml").write_text(OmegaConf.to_yaml(task, resolve=True))
        about = {
            "version": __version__,
            "command": config.hydra.job.name,
            "overrides": list(config.hydra.overrides.task),
            "started": datetime.now(UTC).isoformat(timespec="seconds"),
            "python": platform.python_version(),
            "packages": {name: version(name) for name in RECORDED_PACKAGES},
        }
        (folder / "run.json").write_text(json.dumps(about, indent=2) + "\n")

    def _claim(self, config: DictConfig, folder: str) -> None:
        try:
            claim_folder(Path(folder))
        except BadInput as error:  # Hydra only warns of exceptions in callbacks
            _fail(config.hydra.job.name, str(error))
