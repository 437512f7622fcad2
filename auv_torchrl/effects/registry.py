"""Effects by name: those of the package, of other packages that are installed, and of one's own folder."""

import os
import re
import sys
from collections.abc import ItemsView, Iterable, Iterator, Mapping, ValuesView
from importlib.metadata import EntryPoint, entry_points
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

from auv_torchrl.effects.effect import Effect
from auv_torchrl.paths import OWN, own_folder

GROUP = "auv_torchrl.effects"  # of entry points; each names an effect or several


class Registry(Mapping[str, Effect]):
    """Effects in the order in which they are applied: those of the package first.

    Others are read when the registry is first looked into, and not when this package is imported, because what
    declares them imports it. A file of one's own is ``effects/*.py`` in the folder that ``AUV_CONF`` names and ends
    with ``EFFECTS = (my_effect,)``; a package names the same under the entry-point group ``auv_torchrl.effects``.

    Raises:
        ValueError: for what cannot be read, is no effect, or has a name that there is already.
    """

    def __init__(self, effects: Iterable[Effect]) -> None:
        self._built_in = _with({}, effects, "this package")
        self._known: dict[str | None, dict[str, Effect]] = {}  # by AUV_CONF

    def __getitem__(self, name: str) -> Effect:
        return self._effects()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._effects())

    def __len__(self) -> int:
        return len(self._effects())

    def items(self) -> ItemsView[str, Effect]:
        """Names and effects, looked up once and not one by one: the diagnosis goes through them at every step."""
        return self._effects().items()

    def values(self) -> ValuesView[Effect]:
        """The effects, likewise."""
        return self._effects().values()

    def _effects(self) -> dict[str, Effect]:
        given = os.environ.get(OWN)
        if given not in self._known:
            self._known[given] = self._built_in  # what files see that look in here while they are read
            try:
                self._known[given] = self._read(self._built_in)
            except BaseException:
                del self._known[given]
                raise
        return self._known[given]

    @staticmethod
    def _read(known: dict[str, Effect]) -> dict[str, Effect]:
        for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name):
            known = _with(known, _declared(entry), f"the entry point {entry.value}")
        own = own_folder()
        for path in sorted((own / "effects").glob("*.py")) if own is not None else ():
            known = _with(known, _declared(path), str(path))
        return known


def _declared(source: EntryPoint | Path) -> Iterable[Any]:
    name = str(source) if isinstance(source, Path) else f"the entry point {source.value}"
    try:
        found = _executed(source) if isinstance(source, Path) else source.load()
    except Exception as error:  # whatever somebody else's file may raise
        cause = " ".join(f"{type(error).__name__}: {error}".split())
        raise ValueError(f"effects in {name} cannot be read ({cause}): mend it") from error
    return found if isinstance(found, list | tuple) else [found]


def _executed(path: Path) -> Any:
    spec = spec_from_file_location(f"{GROUP}.own.{path.stem}", path)
    assert spec is not None and spec.loader is not None  # as for every path that ends with .py
    module = module_from_spec(spec)
    sys.modules[spec.name] = module  # where dataclasses and pickle look for it
    spec.loader.exec_module(module)
    return module.EFFECTS


def _with(known: Mapping[str, Effect], effects: Iterable[Any], where: str) -> dict[str, Effect]:
    together = dict(known)
    for effect in effects:
        if not isinstance(effect, Effect):
            raise ValueError(f"{effect!r} in {where} is no Effect: end it with EFFECTS = (my_effect,)")
        if not re.fullmatch(r"[a-z][a-z0-9_]*", effect.name):
            raise ValueError(f"effect {effect.name!r} in {where}: give a name of small letters, digits and _")
        if effect.name in together:
            raise ValueError(f"effect {effect.name!r} in {where}: there is one of that name already: rename it")
        together[effect.name] = effect
    return together
