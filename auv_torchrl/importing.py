"""Imports of torch in less time, for a command that trains and knows what its process will do."""

import gc
import os
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any


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
