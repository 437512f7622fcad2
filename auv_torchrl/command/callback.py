"""What Hydra calls before a run or a job begins: its folder is claimed, and how it was started is written down."""

import logging
from pathlib import Path
from typing import Any

from hydra.experimental.callback import Callback
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from auv_torchrl.command.errors import BadInput, fail
from auv_torchrl.command.folder import claim_folder, finish, goes_on, is_finished

log = logging.getLogger(__name__)


class OutputFolder(Callback):
    """Refuses a used output folder before anything is written, then records how each job was started."""

    def on_run_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Claim the folder of a single run."""
        self._claim(config, config.hydra.run.dir, _settings(config))

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Claim the folder of a sweep."""
        self._claim(config, config.hydra.sweep.dir, "")

    def on_multirun_end(self, config: DictConfig, **kwargs: Any) -> None:
        """Every job has ended well."""
        finish(Path(config.hydra.sweep.dir))

    def on_job_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Claim the folder of a job of a sweep, unless it ended there before the sweep was broken off."""
        folder = Path(config.hydra.runtime.output_dir)
        if config.hydra.mode is RunMode.MULTIRUN and not is_finished(folder):
            self._claim(config, str(folder), _settings(config), (f"{config.hydra.job.name}.log",))
        if goes_on(folder):
            log.info("going on with the unfinished run in %s", folder)

    def _claim(self, config: DictConfig, folder: str, settings: str, ours: tuple[str, ...] = ()) -> None:
        try:
            claim_folder(Path(folder), config.hydra.job.name, settings, list(config.hydra.overrides.task), ours)
        except BadInput as error:  # Hydra only warns of exceptions in callbacks
            fail(config.hydra.job.name, error)


def _settings(config: DictConfig) -> str:
    task = OmegaConf.masked_copy(config, [str(key) for key in config if key != "hydra"])
    return OmegaConf.to_yaml(task, resolve=True)
