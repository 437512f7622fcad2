"""Imports of large libraries in less time; each is for a command alone, which knows what its process will do."""

import gc
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from importlib.abc import MetaPathFinder
from types import ModuleType
from typing import Any, cast
from unittest.mock import patch

_MARKS = ("allow_in_graph", "assume_constant_result")  # each loads torch's whole compiler when it is called
_COMPILER = "torch._dynamo"
_PUT_OFF = (  # what libraries load for those who compile or render, and nothing here asks for; torch's in this order
    "torch._meta_registrations",
    "torch.export",
    "numpy.f2py",
    "dm_control._render",
)


@contextmanager
def importing() -> Iterator[None]:
    """Import what is inside without a search for garbage, which takes a third of the 2.4 s of torch and the others.

    A library leaves no garbage behind when it is imported, yet the collector walks over all of its functions and
    classes again and again as they become more. What is there in the end stays for as long as the process lives, so
    the collector need not look at it later either.
    """
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if not gc.get_freeze_count():  # once: a process that runs several commands has garbage later on
            gc.freeze()
        if collects:
            gc.enable()


@contextmanager
def importing_without_compiler() -> Iterator[None]:
    """The same, and let functions be marked for ``torch.compile`` without loading it, 1.2 of 3.6 CPU seconds.

    tensordict does so with two functions of its own when it is imported. They do the same without the mark; a process
    that compiled what calls them would need it, and neither a diagnosis nor a reader does. What libraries keep for
    compilers besides, 0.5 s, is put off until somebody asks for it.
    """
    with importing():
        _put_off()
        import torch.compiler  # here, not above: it takes a second

        with patch.multiple(torch.compiler, **dict.fromkeys(_MARKS, _unmarked)):
            yield


def _put_off() -> None:
    import_module("numpy")  # which must be there, and torch must not, before a part of it is put off
    for name in _PUT_OFF:
        if name not in sys.modules:
            later = sys.modules[name] = _Later(name)
            parent, _, child = name.rpartition(".")
            if parent in sys.modules:
                setattr(sys.modules[parent], child, later)
    if not any(isinstance(finder, _BeforeCompiler) for finder in sys.meta_path):
        sys.meta_path.insert(0, _BeforeCompiler())


class _Later(ModuleType):
    """A module that is loaded when something of it is asked for.

    The standard library's own, ``LazyLoader``, is loaded by who asks what file a module is of, and torch asks all.
    """

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") and name != "__path__":
            raise AttributeError(name)
        return getattr(self.load(), name)

    def load(self) -> ModuleType:
        """The module itself, which takes the place of this one."""
        if sys.modules.get(self.__name__) is self:
            del sys.modules[self.__name__]
        return import_module(self.__name__)


class _BeforeCompiler(MetaPathFinder):
    """Loads what was put off before torch's compiler, which can only be loaded after it."""

    def find_spec(self, name: str, *_: Any) -> None:
        """Find nothing."""
        if name == _COMPILER:
            for later in map(sys.modules.get, _PUT_OFF):
                if isinstance(later, _Later):
                    later.load()


def convert_without_pandas() -> None:
    """Have pyarrow make arrays without loading pandas first, 0.2 s, for as long as the process lives.

    It no longer knows a series of pandas then, until ``to_pandas`` has loaded it.
    """
    import pyarrow as pa  # here, not above: not every command needs it

    if "pandas" not in sys.modules:
        sys.modules["pandas"] = cast(ModuleType, None)  # there is none
        with suppress(ImportError, AttributeError):
            pa.array([])
        del sys.modules["pandas"]


def _unmarked(function: Callable[..., Any]) -> Callable[..., Any]:
    return function
