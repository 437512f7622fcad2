"""Entries of a vehicle file as arrays; what is no number, or too many, is refused by name."""

import math
from numbers import Real
from reprlib import repr as short
from typing import Any

import numpy as np

from auv_torchrl.quantities import counted
from auv_torchrl.vehicle.checks import looks_like
from auv_torchrl.vehicle.fields import BY_LABEL


def read_entry(label: str, value: Any, position: Any) -> np.ndarray:
    """The value of an entry as an array, within what is possible; one per thruster or one for all where a file may.

    Args:
        label: of the entry.
        value: in the file.
        position: places of the thrusters in the file, a row for each.

    Raises:
        ValueError: for anything else, naming the entry.
    """
    kind = BY_LABEL[label]
    if kind.rows:
        array = matrix(label, value, kind.length)
    elif kind.each and isinstance(value, list | tuple):
        array = _each_thruster(label, value, position)
    elif kind.square:
        array = _square(label, value, kind.length)
    else:
        array = numbers(label, value, (kind.length,) if kind.length else ())
    return bounded(label, value, array)


def _square(label: str, value: Any, size: int) -> np.ndarray:
    """The numbers of the diagonal, or all rows of a matrix."""
    if isinstance(value, list | tuple) and len(value) == size and all(isinstance(row, list | tuple) for row in value):
        return matrix(label, value, size)
    return np.diag(numbers(label, value, (size,), f"{counted(size, 'number')}, or {counted(size, 'row')} of {size}"))


def _each_thruster(label: str, values: Any, position: Any) -> np.ndarray:
    """One number for each row of the thrusters' ``position``."""
    n = len(matrix("thrusters.position", position, 3))
    return numbers(label, values, (n,), f"one number, or {n}, one per thruster")


def bounded(label: str, value: Any, array: np.ndarray) -> np.ndarray:
    """The numbers of an entry, which ``value`` is in the file, where they lie within what is possible of it.

    Raises:
        ValueError: for others, with the unit that they look like.
    """
    given = BY_LABEL[label].given
    found = array.diagonal() if BY_LABEL[label].square else array  # beside the diagonal, signs are free
    if not all(number in given for number in found.flatten().tolist()):
        looks = looks_like(label, found)
        raise ValueError(f"{label} is {short(value)}: give values {given}{looks}")
    return array


def numbers(label: str, value: Any, shape: tuple[int, ...], wanted: str = "") -> np.ndarray:
    """Finite numbers of a shape; ``wanted`` is what an error asks for.

    Raises:
        ValueError: for anything else, naming the entry by its ``label``.
    """
    wanted = wanted or (counted(math.prod(shape), "number") if shape else "one number")
    given = value.tolist() if isinstance(value, np.ndarray | np.generic) else value
    entries = given if isinstance(given, list | tuple) else (given,)
    if any(isinstance(entry, bool) or not isinstance(entry, Real) for entry in entries):
        raise ValueError(f"{label} is {short(value)}: give {wanted}")
    try:
        array = np.asarray(given, dtype=np.float64)
    except OverflowError as error:
        raise ValueError(f"{label} is {short(value)}: give {wanted}") from error
    if array.shape != shape or not np.isfinite(array).all():
        raise ValueError(f"{label} is {short(value)}: give {wanted}, finite")
    return array


def matrix(label: str, value: Any, columns: int) -> np.ndarray:
    """Rows of as many numbers, at least one.

    Raises:
        ValueError: for anything else, naming the entry.
    """
    if not isinstance(value, list | tuple) or not value:
        raise ValueError(f"{label} is {short(value)}: give one row of {counted(columns, 'number')} per thruster")
    return np.stack([numbers(f"{label}[{row}]", entry, (columns,)) for row, entry in enumerate(value)])
