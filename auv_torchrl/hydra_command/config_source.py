"""Where Hydra's configuration comes from: files, each checked before it is loaded, one's own too, and schemas."""

from pathlib import Path

from hydra._internal.core_plugins.file_config_source import FileConfigSource
from hydra._internal.core_plugins.structured_config_source import StructuredConfigSource
from hydra._internal.sources_registry import SourcesRegistry
from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.object_type import ObjectType
from hydra.core.plugins import Plugins
from hydra.plugins.config_source import ConfigLoadError, ConfigResult
from hydra.plugins.search_path_plugin import SearchPathPlugin

from auv_torchrl.paths import ENDINGS, OWN, PLAIN, SCHEMA, own_folder
from auv_torchrl.yaml_file import YamlFileError, read_yaml


class CheckedFiles(FileConfigSource):
    """Files of configuration; those that :func:`auv_torchrl.yaml_file.read_yaml` refuses are errors of one line.

    What is chosen for a group of :data:`PLAIN` is a name, or a file anywhere: ``vehicle=path/to/mine.yaml``.
    """

    def is_config(self, config_path: str) -> bool:
        """Whether there is such a file; a folder of that name is an error, not an unknown name."""
        path = self._path(config_path)
        if path.is_dir() or self._elsewhere(config_path):
            self._check(config_path)
        return path.is_file()

    def load_config(self, config_path: str) -> ConfigResult:
        """Check a file, then load it."""
        self._check(config_path)
        return super().load_config(str(self._path(config_path)))  # an absolute path stays what it is

    def _check(self, config_path: str) -> None:
        group = config_path.partition("/")[0] if self._elsewhere(config_path) else config_path.rpartition("/")[0]
        try:
            read_yaml(self._path(config_path), group or "configuration", plain=group in PLAIN)
        except (YamlFileError, FileNotFoundError) as error:
            raise ConfigLoadError(str(error)) from error

    def _path(self, config_path: str) -> Path:
        elsewhere = self._elsewhere(config_path)
        return elsewhere or (Path(self.path) / self._normalize_file_name(config_path)).absolute()

    def _elsewhere(self, config_path: str) -> Path | None:
        """The file that ``vehicle/path/to/mine.yaml`` stands for; None for an entry of this folder."""
        group, _, chosen = config_path.partition("/")
        if group not in PLAIN or not chosen.endswith(ENDINGS):
            return None
        path = Path(chosen).expanduser().absolute()
        return None if (Path(self.path) / config_path).is_file() and not path.exists() else path

    @staticmethod
    def _normalize_file_name(filename: str) -> str:
        return filename if filename.endswith(ENDINGS) else f"{filename}.yaml"


class UnlistedSchemas(StructuredConfigSource):
    """What Python has told Hydra; files name schemas in their defaults, nobody chooses one."""

    def list(self, config_path: str, results_filter: ObjectType | None) -> list[str]:
        """The entries of a group but its schemas."""
        return [name for name in super().list(config_path, results_filter) if not name.endswith(SCHEMA)]


# Hydra registers its own sources anew in each process of a sweep: one of the same name stays, another is an error.
CheckedFiles.__name__ = FileConfigSource.__name__
UnlistedSchemas.__name__ = StructuredConfigSource.__name__


class OwnFolder(SearchPathPlugin):
    """Lets Hydra find the groups of one's own folder."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Add the folder after those that are there; none of its names is in them."""
        if (own := own_folder()) is not None:
            search_path.append(OWN, f"{CheckedFiles.scheme()}://{own}")


def check_config_files() -> None:
    """Let Hydra read files through :class:`CheckedFiles` from now on, in processes of a sweep too; list no schemas."""
    for source in (CheckedFiles, UnlistedSchemas):
        SourcesRegistry.instance().types[source.scheme()] = source
    Plugins.instance().register(OwnFolder)
