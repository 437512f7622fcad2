"""How far a sweep is: its jobs may run in other processes, so their folders are watched."""

import math
import sys
import threading
from contextlib import suppress
from pathlib import Path

from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import DictConfig

from auv_torchrl.command.folder import is_finished
from auv_torchrl.progress import Progress
from auv_torchrl.quantities import counted

_EVERY_S = 0.5  # between two looks at the folders
_SWEEPER = "basic"  # Hydra's own


class SweepProgress:
    """Shows how many jobs of a sweep have finished, from :meth:`begin` to :meth:`end`."""

    def __init__(self) -> None:
        self._progress: Progress | None = None
        self._over, self._watcher = threading.Event(), threading.Thread()

    def begin(self, config: DictConfig) -> None:
        """Watch the jobs of a sweep; another sweeper than Hydra's own does not say how many there will be."""
        if config.hydra.runtime.choices["hydra/sweeper"] != _SWEEPER:
            return
        self.end()
        self._progress = Progress(say=_print).__enter__()
        watched = self._progress, Path(config.hydra.sweep.dir), jobs_of(config)
        self._over.clear()
        self._watcher = threading.Thread(target=self._watch, args=watched, daemon=True)
        self._watcher.start()

    def end(self) -> None:
        """Watch no longer."""
        if self._progress is not None:
            self._over.set()
            self._watcher.join()
            self._progress.__exit__()
            self._progress = None

    def _watch(self, progress: Progress, folder: Path, total: int) -> None:
        finished: set[Path] = set()
        is_over = False
        while not is_over:
            is_over = self._over.wait(_EVERY_S)  # and one look behind the end, for the jobs that finished last
            with suppress(OSError):  # a job removes or replaces what was listed
                finished |= {job for job in folder.iterdir() if job not in finished and is_finished(job)}
            progress(f"{len(finished)} of {counted(total, 'run')} finished", len(finished) / total)


def jobs_of(config: DictConfig) -> int:
    """How many jobs the sweep of a config has."""
    given = [f"{key}={value}" for key, value in (config.hydra.sweeper.params or {}).items()]
    parser = OverridesParser.create(config_loader=GlobalHydra.instance().config_loader())
    overrides = parser.parse_overrides([*given, *config.hydra.overrides.task])
    values = {one.get_key_element(): one for one in overrides}  # the last of a key counts
    return math.prod(len(list(one.sweep_string_iterator())) for one in values.values() if one.is_sweep_override())


def _print(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()
