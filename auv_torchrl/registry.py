"""Things by name: those of the package, of other packages that are installed, and of one's own folder."""

import os
import re
import sys
from collections.abc import ItemsView, Iterable, Iterator, Mapping, ValuesView
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any, Generic, TypeVar, cast

from auv_torchrl.paths import OWN, own_folder

Entry = TypeVar("Entry")
_REGISTRIES = {  # by folder of one's own, where it is read; imported when there is something to read
    "agents": "auv_torchrl.agents.config",
    "effects": "auv_torchrl.effects",
    "readers": "auv_torchrl.flightlog.readers",
    "sensors": "auv_torchrl.sensors",
    "tasks": "auv_torchrl.tasks",
}
PYTHON_FOLDERS = tuple(_REGISTRIES)  # of a folder of one's own


class Registry(Mapping[str, Entry], Generic[Entry]):
    """Entries of one kind in their order: those of the package first.

    Others are read when the registry is first looked into, and not when this package is imported, because what
    declares them imports it. A file of one's own is ``effects/*.py`` in the folder that ``AUV_CONF`` names and ends
    with ``EFFECTS = (my_effect,)``; a package names the same under the entry-point group ``auv_torchrl.effects``.
    Likewise ``agents``, ``readers``, ``sensors`` and ``tasks``.

    Args:
        folder: ``effects`` and so on.
        kind: what entries are instances of, or subclasses where entries are classes; each has a ``name``.
        entries: those of the package.
        name: pattern that names match.

    Raises:
        ValueError: for what cannot be read, is of another kind, or has a name that there is already.
    """

    def __init__(self, folder: str, kind: type, entries: Iterable[Entry], name: str = "[a-z][a-z0-9_]*") -> None:
        self.folder, self.group = folder, _group(folder)  # the latter of entry points
        self._kind, self._name = kind, name
        self._built_in = self._with({}, entries, "this package")
        self._known: dict[str | None, dict[str, Entry]] = {}  # by AUV_CONF

    def __getitem__(self, name: str) -> Entry:
        return self._entries()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries())

    def __len__(self) -> int:
        return len(self._entries())

    def items(self) -> ItemsView[str, Entry]:
        """Names and entries, looked up once and not one by one: the diagnosis goes through effects at every step."""
        return self._entries().items()

    def values(self) -> ValuesView[Entry]:
        """The entries, likewise."""
        return self._entries().values()

    @property
    def extended(self) -> bool:
        """Whether there are entries from outside the package."""
        return len(self) > len(self._built_in)

    def _entries(self) -> dict[str, Entry]:
        given = os.environ.get(OWN)
        if given not in self._known:
            self._known[given] = self._built_in  # what files see that look in here while they are read
            try:
                self._known[given] = self._read(self._built_in)
            except BaseException:
                del self._known[given]
                raise
        return self._known[given]

    def _read(self, known: dict[str, Entry]) -> dict[str, Entry]:
        for source in _outside(self.folder):
            name = str(source) if isinstance(source, Path) else f"the entry point {source.value}"
            known = self._with(known, self._declared(source, name), name)
        return known

    def _declared(self, source: EntryPoint | Path, name: str) -> Iterable[Any]:
        try:
            found = self._executed(source) if isinstance(source, Path) else source.load()
        except Exception as error:  # whatever somebody else's file may raise
            cause = " ".join(f"{type(error).__name__}: {error}".split())
            raise ValueError(f"{self.folder} in {name} cannot be read ({cause}): mend it") from error
        one = not isinstance(found, list | tuple) or isinstance(found, self._kind)  # a reader is a tuple itself
        return [found] if one else found

    def _executed(self, path: Path) -> Any:
        spec = spec_from_file_location(f"{self.group}.own.{path.stem}", path)
        assert spec is not None and spec.loader is not None  # as for every path that ends with .py
        module = module_from_spec(spec)
        sys.modules[spec.name] = module  # where dataclasses and pickle look for it
        spec.loader.exec_module(module)
        return getattr(module, self.folder.upper())

    def _with(self, known: Mapping[str, Entry], entries: Iterable[Any], where: str) -> dict[str, Entry]:
        together, word = dict(known), self.folder.removesuffix("s")
        for entry in entries:
            if not (issubclass(entry, self._kind) if isinstance(entry, type) else isinstance(entry, self._kind)):
                ending = f"{self.folder.upper()} = (my_{word},)"
                raise ValueError(f"{entry!r} in {where} is no {self._kind.__name__}: end it with {ending}")
            if not re.fullmatch(self._name, entry.name):
                raise ValueError(f"{word} {entry.name!r} in {where}: give a name of small letters, digits and _")
            if entry.name in together:
                raise ValueError(f"{word} {entry.name!r} in {where}: there is one of that name already: rename it")
            together[entry.name] = cast(Entry, entry)
        return together


def read_all() -> None:
    """Read what is declared outside of the package, so that what is wrong with it is said at once.

    Raises:
        ValueError: see :class:`Registry`.
    """
    for folder, module in _REGISTRIES.items():
        if _outside(folder):
            len(getattr(import_module(module), folder.upper()))


def _outside(folder: str) -> list[EntryPoint | Path]:
    """What declares entries outside of the package, in the order in which it is read."""
    installed = sorted(entry_points(group=_group(folder)), key=lambda entry: entry.name)
    own = own_folder()
    return [*installed, *(sorted((own / folder).glob("*.py")) if own is not None else ())]


def _group(folder: str) -> str:
    """The group of entry points, and of the modules that files of one's own become."""
    return f"auv_torchrl.{folder}"
