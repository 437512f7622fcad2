"""Hydra's files of configuration, each checked before Hydra loads it."""

from pathlib import Path

from hydra._internal.core_plugins.file_config_source import FileConfigSource
from hydra._internal.sources_registry import SourcesRegistry
from hydra.plugins.config_source import ConfigLoadError, ConfigResult

from auv_torchrl.yaml_file import YamlFileError, read_yaml

PLAIN = ("vehicle", "scenario", "randomization")  # groups of physical numbers, which depend on nothing outside of them


class CheckedFiles(FileConfigSource):
    """Files of configuration; those that :func:`auv_torchrl.yaml_file.read_yaml` refuses are errors of one line."""

    def is_config(self, config_path: str) -> bool:
        """Whether there is such a file; a folder of that name is an error, not an unknown name."""
        if self._path(config_path).is_dir():
            self._check(config_path)
        return super().is_config(config_path)

    def load_config(self, config_path: str) -> ConfigResult:
        """Check a file, then load it."""
        self._check(config_path)
        return super().load_config(config_path)

    def _check(self, config_path: str) -> None:
        group = config_path.rpartition("/")[0]
        try:
            read_yaml(self._path(config_path), group or "configuration", plain=group in PLAIN)
        except YamlFileError as error:
            raise ConfigLoadError(str(error)) from error

    def _path(self, config_path: str) -> Path:
        return Path(self.path) / self._normalize_file_name(config_path)


# Hydra registers its own sources anew in each process of a sweep: one of the same name stays, another is an error.
CheckedFiles.__name__ = FileConfigSource.__name__


def check_config_files() -> None:
    """Let Hydra read files through :class:`CheckedFiles` from now on, in processes of a sweep too."""
    SourcesRegistry.instance().types[CheckedFiles.scheme()] = CheckedFiles
