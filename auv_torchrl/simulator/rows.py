"""Replacing some vehicles' rows in arrays of numpy or torch, without touching what was handed out before."""

from typing import Any

from array_api_compat import array_namespace, is_torch_array

Array = Any


def with_rows(array: Array, rows: Array, new: Array) -> Array:
    """A copy of ``array`` (N, ...) whose ``rows`` are ``new``."""
    copy = array.clone() if is_torch_array(array) else array.copy()
    copy[rows] = new
    return copy


def lengthened(memory: Array, length: int) -> Array:
    """The memory (N, L, k), newest first, with at least ``length`` entries; the oldest is repeated."""
    missing = length - memory.shape[1]
    if missing <= 0:
        return memory
    xp = array_namespace(memory)
    return xp.concat((memory, *[memory[:, -1:]] * missing), axis=1)
