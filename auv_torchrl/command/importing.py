"""Imports of large libraries without collections of garbage in between."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


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
