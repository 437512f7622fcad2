"""Imports of tensordict without torch's compiler, which no diagnosis uses."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

_MARKS = ("allow_in_graph", "assume_constant_result")  # each loads the whole compiler when it is called


@contextmanager
def without_compiler() -> Iterator[None]:
    """Let what is imported inside mark functions for ``torch.compile`` without loading it, 1.2 of 3.6 CPU seconds.

    tensordict does so with two functions of its own when it is imported. They do the same without the mark; a process
    that compiled what calls them would need it, so this is for the command alone.
    """
    import torch.compiler  # here, not above: it takes a second

    with patch.multiple(torch.compiler, **dict.fromkeys(_MARKS, _unmarked)):
        yield


def _unmarked(function: Callable[..., Any]) -> Callable[..., Any]:
    return function
