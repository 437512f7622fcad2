"""Public names of a package that are imported when they are first asked for.

``--help`` and a mistaken command line are answered without torch, which takes seconds to load. So a package of which
they need a part imports nothing by itself: ``__getattr__ = late(__name__, ...)``, as PEP 562 has it, finds its names.
"""

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def late(package: str, names: Mapping[str, str]) -> Callable[[str], Any]:
    """The ``__getattr__`` of a package whose names are imported when they are first asked for.

    Args:
        package: its ``__name__``.
        names: by module of the package, those that come from it, with spaces between; none may be called as
            a module is.
    """
    homes = {name: module for module, found in names.items() for name in found.split()}

    def find(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(f"{package}.{homes[name]}"), name)
        setattr(sys.modules[package], name, value)  # so that the next look finds it without this function
        return value

    return find
