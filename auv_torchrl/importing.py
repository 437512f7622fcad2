"""Imports of large libraries in less time; each is for a command alone, which knows what its process will do."""

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

_MARKS = ("allow_in_graph", "assume_constant_result")  # each loads torch's whole compiler when it is called


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
    that compiled what calls them would need it, and neither a diagnosis nor a reader does.
    """
    with importing():
        import torch.compiler  # here, not above: it takes a second

        with patch.multiple(torch.compiler, **dict.fromkeys(_MARKS, _unmarked)):
            yield


def _unmarked(function: Callable[..., Any]) -> Callable[..., Any]:
    return function
