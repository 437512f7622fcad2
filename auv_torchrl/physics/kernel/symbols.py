"""A third array library beside numpy and torch: arrays of symbols that record what is computed with them."""

from collections.abc import Callable
from functools import partial
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from auv_torchrl.physics.kernel.tape import Number, Operation, Recorder

__all__ = ["NAMESPACE", "Number", "Operation", "Symbols", "Tape"]


def _by(operator: Callable[[Any, Any], Any], swapped: bool = False) -> Any:
    def method(self: "Symbols", other: Any) -> "Symbols":
        ours, theirs = self.numbers, _numbers(other)
        return Symbols(operator(theirs, ours) if swapped else operator(ours, theirs))

    return method


class Symbols:
    """An array of symbolic numbers, with the operators of the array API that the physics uses."""

    __array_priority__ = 1000  # numpy arrays leave an operation with it to it
    device = None
    dtype = float

    def __init__(self, numbers: Any):
        self.numbers = np.asarray(numbers, dtype=object)

    def __array_namespace__(self, api_version: str | None = None) -> Any:
        return NAMESPACE

    @property
    def shape(self) -> tuple[int, ...]:
        """As of any array."""
        return self.numbers.shape

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return self.numbers.ndim

    @property
    def T(self) -> "Symbols":  # noqa: N802
        """Both axes exchanged."""
        return Symbols(self.numbers.T)

    @property
    def mT(self) -> "Symbols":  # noqa: N802
        """The last two axes exchanged."""
        return Symbols(self.numbers.mT)

    def reshape(self, *shape: int) -> "Symbols":
        """As of any array."""
        return Symbols(self.numbers.reshape(*shape))

    def __getitem__(self, index: Any) -> "Symbols":
        return Symbols(self.numbers[index])

    def __setitem__(self, index: Any, value: Any) -> None:
        self.numbers[index] = _numbers(value)

    __add__, __radd__ = _by(np.add), _by(np.add, True)
    __sub__, __rsub__ = _by(np.subtract), _by(np.subtract, True)
    __mul__, __rmul__ = _by(np.multiply), _by(np.multiply, True)
    __truediv__, __rtruediv__ = _by(np.true_divide), _by(np.true_divide, True)
    __pow__ = _by(np.power)
    __matmul__, __rmatmul__ = _by(np.matmul), _by(np.matmul, True)

    def __lt__(self, other: Any) -> "Symbols":
        return _elementwise("less", self, other)

    def __gt__(self, other: Any) -> "Symbols":
        return _elementwise("less", other, self)

    def __neg__(self) -> "Symbols":
        return _elementwise("neg", self)


class Tape(Recorder):
    """The program that is being recorded, given arrays of numbers."""

    def inputs(self, name: str, shape: tuple[int, ...]) -> Symbols:
        """An array of numbers that the program is given."""
        numbers = np.empty(shape, object)
        for place, index in enumerate(np.ndindex(shape)):
            numbers[index] = self.input(name, place)
        return Symbols(numbers)


def _numbers(given: Any) -> Any:
    return given.numbers if isinstance(given, Symbols) else np.asarray(given, dtype=object)


def _elementwise(kind: str, *given: Any) -> Symbols:
    arrays = np.broadcast_arrays(*(_numbers(each) for each in given))
    tape = next(number.tape for array in arrays for number in array.flat if isinstance(number, Number))
    result = np.empty(arrays[0].shape, object)
    for index in np.ndindex(result.shape):
        result[index] = tape.apply(kind, *[cast(Number, array[index]) for array in arrays])
    return Symbols(result)


def _of(function: Callable[..., Any]) -> Callable[..., Symbols]:
    """A function of numpy that only moves numbers, for symbols."""

    def moved(given: Any, *arguments: Any, **options: Any) -> Symbols:
        numbers = [_numbers(each) for each in given] if isinstance(given, tuple | list) else _numbers(given)
        return Symbols(function(numbers, *arguments, **options))

    return moved


def _minimum(a: Any, b: Any) -> Symbols:
    return _elementwise("where", _elementwise("less", b, a), b, a)  # no number where ``a`` is none, as of numpy


def _maximum(a: Any, b: Any) -> Symbols:
    return _elementwise("where", _elementwise("less", a, b), b, a)


NAMESPACE = SimpleNamespace(
    __name__="symbols",
    concat=_of(np.concatenate),
    stack=_of(np.stack),
    moveaxis=_of(np.moveaxis),
    permute_dims=_of(np.transpose),
    sum=_of(np.sum),
    linalg=SimpleNamespace(diagonal=_of(lambda a: np.diagonal(a, axis1=-2, axis2=-1))),
    zeros=lambda shape, dtype=None, device=None: Symbols(np.zeros(shape)),
    zeros_like=lambda a: Symbols(np.zeros(a.shape)),
    ones_like=lambda a: Symbols(np.ones(a.shape)),
    asarray=lambda a, dtype=None, device=None: Symbols(np.asarray(a, float)),
    **{kind: partial(_elementwise, kind) for kind in ("abs", "sqrt", "exp", "sin", "cos", "tanh", "atan2", "round")},
    minimum=_minimum,
    maximum=_maximum,
    clip=lambda a, low, high: _minimum(_maximum(a, low), high),
    where=lambda condition, a, b: _elementwise("where", condition, a, b),
)
