"""Memory of the arrays of a diagnosis, which are made and given back thousands of times."""

import ctypes
from typing import Any

# Of mallopt, see malloc.h of the GNU C library
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
_KEPT = 2**30  # bytes
_LARGE = 32 * 2**20  # bytes; what is larger would leave holes that nothing else fits, and is given back at once


def keep_freed_memory() -> None:
    """Have the C library keep what arrays give back for those that come next, for as long as the process lives.

    It gives arrays of some MB back to the system at once, which then clears every page anew for the next one: a tenth
    of the time of a long dive. It is for a command alone, which knows what its process will do. Other C libraries than
    GNU's are left as they are.
    """
    mallopt = _of_the_c_library("mallopt")
    if mallopt is not None:
        mallopt(_TRIM_THRESHOLD, _KEPT)
        mallopt(_MMAP_THRESHOLD, _LARGE)


def give_back_freed_memory() -> None:
    """Have the C library give back what it keeps: what reading a log left over has holes that little else fits."""
    trim = _of_the_c_library("malloc_trim")
    if trim is not None:
        trim(0)


def _of_the_c_library(name: str) -> Any:
    """A function of it; None where it has none of that name."""
    try:
        return getattr(ctypes.CDLL(None), name)
    except (AttributeError, OSError, TypeError):
        return None
