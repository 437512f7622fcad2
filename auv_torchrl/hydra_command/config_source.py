"""Where Hydra's configuration comes from: files, each checked before it is loaded, one's own too, and schemas."""

from copy import deepcopy
from functools import lru_cache
from pathlib import Path
from typing import Any

from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.config_store import ConfigStore
from hydra.core.object_type import ObjectType
from hydra.core.plugins import Plugins
from hydra.plugins.config_source import ConfigLoadError, ConfigResult, ConfigSource
from hydra.plugins.search_path_plugin import SearchPathPlugin
from omegaconf import DictConfig, ListConfig, OmegaConf

from auv_torchrl.paths import ENDINGS, OWN, PLAIN, SCHEMA, own_folder
from auv_torchrl.yaml_file import YamlFileError, read_yaml

_HEADER = 512  # characters at the beginning of a file among which ``# @package`` is looked for
_SCHEMAS = "schema"  # before the group of a schema in Hydra's store, so that no group lists one


def store_schema(schema: type, group: str, name: str) -> None:
    """Let files of a group name a schema in their defaults, as ``<name>_schema``; nobody chooses one."""
    store_once(name, schema, f"{_SCHEMAS}/{group}")


def store_once(name: str, schema: type, group: str = "") -> None:
    """Put a schema into Hydra's store, unless it is there: a command asks for the same ones several times."""
    store = ConfigStore.instance()
    there: Any = store.repo
    for part in filter(None, group.split("/")):
        there = there.get(part, {})
    stored = there.get(f"{name}.yaml")
    if stored is None or OmegaConf.get_type(stored.node) is not schema:
        store.store(name, schema, group=group or None)


@lru_cache(64)  # Hydra composes three times in a command, and Python parses a file for 10 ms each time
def _created(text: str) -> DictConfig | ListConfig:
    return OmegaConf.create(text)


class CheckedFiles(ConfigSource):
    """Files of configuration; those that :func:`auv_torchrl.yaml_file.read_yaml` refuses are errors of one line.

    What is chosen for a group of :data:`PLAIN` is a name, or a file anywhere: ``vehicle=path/to/mine.yaml``.
    """

    @staticmethod
    def scheme() -> str:
        """What the addresses of such folders begin with."""
        return "checked"

    def load_config(self, config_path: str) -> ConfigResult:
        """Check a file, then load it; or the schema of that name."""
        if schema := _schema(config_path):
            stored = ConfigStore.instance().load(schema)
            return ConfigResult(self.provider, self.full_path(), stored.node, {"package": stored.package})
        self._check(config_path)
        text = self._path(config_path).read_text(encoding="utf-8-sig")
        header = self._get_header_dict(text[:_HEADER])
        return ConfigResult(self.provider, self.full_path(), deepcopy(_created(text)), header)

    def is_config(self, config_path: str) -> bool:
        """Whether there is such a file; a folder of that name is an error, not an unknown name."""
        path = self._path(config_path)
        if path.is_dir() or self._elsewhere(config_path):
            self._check(config_path)
        return path.is_file() or _schema(config_path) is not None

    def is_group(self, config_path: str) -> bool:
        """Whether it is a folder."""
        return (Path(self.path) / config_path).is_dir()

    def available(self) -> bool:
        """Whether there is such a folder at all."""
        return self.is_group("")

    def list(self, config_path: str, results_filter: ObjectType | None) -> list[str]:
        """The entries of a group."""
        found: list[str] = []
        for path in (Path(self.path) / config_path).iterdir():
            self._list_add_result(found, f"{config_path}/{path.name}".lstrip("/"), path.name, results_filter)
        return sorted(set(found))

    def _check(self, config_path: str) -> None:
        group = config_path.partition("/")[0] if self._elsewhere(config_path) else config_path.rpartition("/")[0]
        try:
            read_yaml(self._path(config_path), group or "configuration", plain=group in PLAIN)
        except (YamlFileError, FileNotFoundError) as error:
            raise ConfigLoadError(str(error)) from error

    def _path(self, config_path: str) -> Path:
        elsewhere = self._elsewhere(config_path)
        return elsewhere or (Path(self.path) / _file_name(config_path)).absolute()

    def _elsewhere(self, config_path: str) -> Path | None:
        """The file that ``vehicle/path/to/mine.yaml`` stands for; None for an entry of this folder."""
        group, _, chosen = config_path.partition("/")
        if group not in PLAIN or not chosen.endswith(ENDINGS):
            return None
        path = Path(chosen).expanduser().absolute()
        return None if (Path(self.path) / config_path).is_file() and not path.exists() else path


def _file_name(config_path: str) -> str:
    return config_path if config_path.endswith(ENDINGS) else f"{config_path}.yaml"


def _schema(config_path: str) -> str | None:
    """Where Hydra's store has the schema ``task/line_schema``; None where it has none of that name."""
    group, _, name = config_path.removesuffix(".yaml").rpartition("/")
    stored = f"{_SCHEMAS}/{group}/{name.removesuffix(SCHEMA)}.yaml"
    is_there = name.endswith(SCHEMA) and ConfigStore.instance().get_type(stored) is ObjectType.CONFIG
    return stored if is_there else None


class CheckedFolders(SearchPathPlugin):
    """Lets Hydra read folders through :class:`CheckedFiles`, and find the groups of one's own folder."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Add one's own folder after those that are there; none of its names is in them."""
        for entry in search_path.get_path():
            if entry.path is not None and "://" not in entry.path:
                entry.path = f"{CheckedFiles.scheme()}://{entry.path}"
        if (own := own_folder()) is not None:
            search_path.append(OWN, f"{CheckedFiles.scheme()}://{own}")


def check_config_files() -> None:
    """Let Hydra read files through :class:`CheckedFiles` from now on, in processes of a sweep too."""
    for plugin in (CheckedFiles, CheckedFolders):
        Plugins.instance().register(plugin)
