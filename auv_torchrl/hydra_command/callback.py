"""What Hydra calls before a run or a job begins: its folder is claimed, and how it was started is written down."""

import logging
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hydra.errors import HydraException
from hydra.experimental.callback import Callback
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from auv_torchrl.command.errors import BadInput, fail, writing
from auv_torchrl.command.folder import claim_folder, finish, goes_on, is_finished
from auv_torchrl.command.terminal import Console
from auv_torchrl.hydra_command.explain import explain
from auv_torchrl.hydra_command.sweep import SweepProgress
from auv_torchrl.progress import show_no_progress

log = logging.getLogger(__name__)
_sweep = SweepProgress()  # of this process: the callback itself travels to the processes of the jobs


class OutputFolder(Callback):
    """Refuses a used output folder before anything is written, then records how each job was started."""

    def on_run_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Claim the folder of a single run."""
        with _or_end(config):
            _claim(config, config.hydra.run.dir, _settings(config))

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Claim the folder of a sweep."""
        with _or_end(config):
            _claim(config, config.hydra.sweep.dir, "")
            _sweep.begin(config)

    def on_multirun_end(self, config: DictConfig, **kwargs: Any) -> None:
        """Every job has ended well."""
        _sweep.end()
        with _or_end(config):
            finish(Path(config.hydra.sweep.dir))

    def on_job_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Claim the folder of a job of a sweep, unless it ended there before the sweep was broken off."""
        folder = Path(config.hydra.runtime.output_dir)
        if config.hydra.mode is RunMode.MULTIRUN:
            _leave_console_to_the_sweep()
        if config.hydra.mode is RunMode.MULTIRUN and not is_finished(folder):
            with _or_end(config):
                _claim(config, str(folder), _settings(config), (f"{config.hydra.job.name}.log",))
        if goes_on(folder):
            log.info("going on with the unfinished run in %s", folder)


@contextmanager
def _or_end(config: DictConfig) -> Iterator[None]:
    """End the command on any error: Hydra only warns of those in callbacks, and the run would go on unclaimed."""
    command = config.hydra.job.name
    try:
        with writing():
            yield
    except BadInput as error:
        fail(command, error)
    except (HydraException, OmegaConfBaseException) as error:
        fail(command, BadInput(explain(config.hydra.job.config_name, error)))
    except Exception:  # a defect of the program
        traceback.print_exc()
        sys.exit(1)


def _leave_console_to_the_sweep() -> None:
    """Let a job say on the console what went wrong alone: its log has all, and other jobs run beside it."""
    show_no_progress()
    for handler in logging.getLogger().handlers:
        if isinstance(handler, Console):
            handler.setLevel(logging.WARNING)


def _claim(config: DictConfig, folder: str, settings: str, ours: tuple[str, ...] = ()) -> None:
    claim_folder(Path(folder), config.hydra.job.name, settings, list(config.hydra.overrides.task), ours)


def _settings(config: DictConfig) -> str:
    task = OmegaConf.masked_copy(config, [str(key) for key in config if key != "hydra"])
    return OmegaConf.to_yaml(task, resolve=True)
