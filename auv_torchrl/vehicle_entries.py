"""Entries of a vehicle file as tensors; what is no number, or too many, is refused by name."""

import math
from reprlib import repr as short
from typing import Any

import torch
from torch import Tensor

from auv_torchrl.quantities import counted
from auv_torchrl.vehicle_checks import looks_like
from auv_torchrl.vehicle_fields import BY_LABEL


def read_entry(label: str, value: Any, position: Any) -> Tensor:
    """The value of an entry as a tensor, within what is possible; one per thruster or one for all where a file may.

    Args:
        label: of the entry.
        value: in the file.
        position: places of the thrusters in the file, a row for each.

    Raises:
        ValueError: for anything else, naming the entry.
    """
    kind = BY_LABEL[label]
    if kind.rows:
        tensor = matrix(label, value, kind.length)
    elif kind.each and isinstance(value, list | tuple):
        tensor = _each_thruster(label, value, position)
    elif kind.square:
        tensor = _square(label, value, kind.length)
    else:
        tensor = numbers(label, value, (kind.length,) if kind.length else ())
    return bounded(label, value, tensor)


def _square(label: str, value: Any, size: int) -> Tensor:
    """The numbers of the diagonal, or all rows of a matrix."""
    if isinstance(value, list | tuple) and len(value) == size and all(isinstance(row, list | tuple) for row in value):
        return matrix(label, value, size)
    return torch.diag(numbers(label, value, (size,), f"{counted(size, 'number')}, or {counted(size, 'row')} of {size}"))


def _each_thruster(label: str, values: Any, position: Any) -> Tensor:
    """One number for each row of the thrusters' ``position``."""
    n = len(matrix("thrusters.position", position, 3))
    return numbers(label, values, (n,), f"one number, or {n}, one per thruster")


def bounded(label: str, value: Any, tensor: Tensor) -> Tensor:
    """The numbers of an entry, which ``value`` is in the file, where they lie within what is possible of it.

    Raises:
        ValueError: for others, with the unit that they look like.
    """
    given = BY_LABEL[label].given
    found = tensor.diagonal() if BY_LABEL[label].square else tensor  # beside the diagonal, signs are free
    if not all(number in given for number in found.flatten().tolist()):
        looks = looks_like(label, found.numpy())
        raise ValueError(f"{label} is {short(value)}: give values {given}{looks}")
    return tensor


def numbers(label: str, value: Any, shape: tuple[int, ...], wanted: str = "") -> Tensor:
    """Finite numbers of a shape; ``wanted`` is what an error asks for.

    Raises:
        ValueError: for anything else, naming the entry by its ``label``.
    """
    wanted = wanted or (counted(math.prod(shape), "number") if shape else "one number")
    if any(isinstance(entry, bool) for entry in (value if isinstance(value, list | tuple) else (value,))):
        raise ValueError(f"{label} is {short(value)}: give {wanted}")
    try:
        tensor = torch.as_tensor(value, dtype=torch.float64)
    except (TypeError, ValueError, RuntimeError, OverflowError) as error:
        raise ValueError(f"{label} is {short(value)}: give {wanted}") from error
    if tensor.shape != shape or not tensor.isfinite().all():
        raise ValueError(f"{label} is {short(value)}: give {wanted}, finite")
    return tensor


def matrix(label: str, value: Any, columns: int) -> Tensor:
    """Rows of as many numbers, at least one.

    Raises:
        ValueError: for anything else, naming the entry.
    """
    if not isinstance(value, list | tuple) or not value:
        raise ValueError(f"{label} is {short(value)}: give one row of {counted(columns, 'number')} per thruster")
    return torch.stack([numbers(f"{label}[{row}]", entry, (columns,)) for row, entry in enumerate(value)])
