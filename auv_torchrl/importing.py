"""Imports of large libraries in less time; each is for a command alone, which knows what its process will do."""

import gc
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.abc import MetaPathFinder
from typing import Any

_MARKS = ("allow_in_graph", "assume_constant_result")  # each loads torch's whole compiler when it is called


@contextmanager
def replaced(owner: Any, **values: Any) -> Iterator[None]:
    """Give attributes of a class or module other values for a while, as unittest.mock would, which imports asyncio."""
    before = {name: getattr(owner, name) for name in values}
    try:
        for name, value in values.items():
            setattr(owner, name, value)
        yield
    finally:
        for name, value in before.items():
            setattr(owner, name, value)


@contextmanager
def importing() -> Iterator[None]:
    """Import what is inside without a search for garbage, which takes a third of the 2.4 s of torch and the others.

    A library leaves no garbage behind when it is imported, yet the collector walks over all of its functions and
    classes again and again as they become more. What is there in the end stays for as long as the process lives, so
    the collector need not look at it later either.

    scipy takes all that numpy has, its translator of Fortran included, which takes 0.1 s to load and which nothing
    here asks for; so numpy does not offer it meanwhile.
    """
    collects = gc.isenabled()
    gc.disable()
    try:
        import numpy  # here, not above: a mistaken command line needs nothing of it

        offered, listed = ([name for name in names if name != "f2py"] for names in (numpy.__all__, dir(numpy)))
        with replaced(numpy, __all__=offered, __dir__=lambda: listed):
            yield
            import_module("array_api_compat.numpy")  # which takes all of numpy too, when it is first asked for
    finally:
        if not gc.get_freeze_count():  # once: a process that runs several commands has garbage later on
            gc.freeze()
        if collects:
            gc.enable()


@contextmanager
def importing_without_compiler() -> Iterator[None]:
    """The same, and let functions be marked for ``torch.compile`` without loading it, 1.2 of 3.6 CPU seconds.

    tensordict does so with two functions of its own when it is imported. They do the same without the mark; a process
    that compiled what calls them would need it, and neither a diagnosis nor a reader does. Nor does either draw with
    MuJoCo, so that dm_control is told to load nothing of OpenGL.
    """
    with importing(), environment(MUJOCO_GL="disabled"):
        import torch.compiler  # here, not above: it takes a second

        with replaced(torch.compiler, **dict.fromkeys(_MARKS, _unmarked)):
            yield


@contextmanager
def environment(**values: str) -> Iterator[None]:
    """Set variables of the environment for a while."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def spare_pandas() -> None:
    """Let pyarrow do without pandas, which it loads with the first list that it is given: 0.35 CPU seconds.

    It looks once in a process whether pandas is there, to know a series when it is given one; a recording gives it
    none. What asks pyarrow for data frames later gets them as ever. A process that imported pandas before keeps it.
    """
    if "pandas" in sys.modules:
        return
    import pyarrow

    finder = _WithoutPandas()
    sys.meta_path.insert(0, finder)
    try:
        pyarrow.array([0.0])
    finally:
        sys.meta_path.remove(finder)


class _WithoutPandas(MetaPathFinder):
    """Says that pandas is not installed."""

    def find_spec(self, fullname: str, path: object, target: object = None) -> None:
        if fullname == "pandas":
            raise ModuleNotFoundError("pandas is not looked for here")


def _unmarked(function: Callable[..., Any]) -> Callable[..., Any]:
    return function
