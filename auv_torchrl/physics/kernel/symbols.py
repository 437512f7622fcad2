"""A third array library beside numpy and torch: arrays of symbols that record what is computed with them.

Physics run on :class:`Symbols` leaves a straight-line program (:class:`Tape`) behind: equal expressions are computed
once, constants are folded, and what adds zero or multiplies by one is left out.
"""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import numpy as np

_COMMUTE = frozenset({"add", "mul"})
_FOLD: dict[str, Callable[..., float]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "inverse": lambda a: 1.0 / a,
    "neg": lambda a: -a,
    "abs": lambda a: abs(a),
    "sqrt": lambda a: float(np.sqrt(a)),
    "exp": lambda a: float(np.exp(a)),
    "less": lambda a, b: float(a < b),
    "where": lambda condition, a, b: a if condition else b,
}


class Operation(NamedTuple):
    """One number of a program: an input (``name`` and place), a constant, or an operation on earlier numbers."""

    kind: str  # "input", "constant" or a key of the table above
    operands: tuple[Any, ...]


class Tape:
    """The program that is being recorded, in the order of computation."""

    def __init__(self):
        self.operations: list[Operation] = []
        self._known: dict[Operation, int] = {}

    def constant(self, value: float) -> "Number":
        """A number that is known now."""
        return self._record(Operation("constant", (float(value),)))

    def inputs(self, name: str, shape: tuple[int, ...]) -> "Symbols":
        """An array of numbers that the program is given."""
        numbers = np.empty(shape, object)
        for place, index in enumerate(np.ndindex(shape)):
            numbers[index] = self._record(Operation("input", (name, place)))
        return Symbols(numbers)

    def apply(self, kind: str, *operands: "Number | float") -> "Number":
        """The outcome of an operation, simplified where that does not change its value."""
        numbers = [given if isinstance(given, Number) else self.constant(given) for given in operands]
        values = [number.value for number in numbers]
        if all(value is not None for value in values):
            return self.constant(_FOLD[kind](*values))
        simple = self._simplified(kind, numbers, values)
        if simple is not None:
            return simple
        places = tuple(number.place for number in numbers)
        return self._record(Operation(kind, tuple(sorted(places)) if kind in _COMMUTE else places))

    def _simplified(self, kind: str, numbers: "list[Number]", values: list[float | None]) -> "Number | None":
        if kind in _COMMUTE or kind == "sub":
            neutral = 1.0 if kind == "mul" else 0.0
            if values[1] == neutral:
                return numbers[0]
            if values[0] == neutral and kind != "sub":
                return numbers[1]
            if kind == "mul" and 0.0 in values:
                return self.constant(0.0)
            if kind == "mul" and -1.0 in values:
                return self.apply("neg", numbers[1 - values.index(-1.0)])
            if kind == "sub" and values[0] == 0.0:
                return self.apply("neg", numbers[1])
            if kind == "add":  # a + (-b) is a - b
                for first, second in (numbers, numbers[::-1]):
                    if second.operation.kind == "neg":
                        return self.apply("sub", first, Number(self, second.operation.operands[0]))
        if kind == "neg" and numbers[0].operation.kind == "neg":
            return Number(self, numbers[0].operation.operands[0])
        return None

    def _record(self, operation: Operation) -> "Number":
        place = self._known.get(operation)
        if place is None:
            place = self._known[operation] = len(self.operations)
            self.operations.append(operation)
        return Number(self, place)


def _with(kind: str, swapped: bool = False) -> Any:
    def method(self: "Number", other: "Number | float") -> "Number":
        return self.tape.apply(kind, other, self) if swapped else self.tape.apply(kind, self, other)

    return method


class Number:
    """One symbolic number: a place on the tape."""

    __slots__ = ("tape", "place")

    def __init__(self, tape: Tape, place: int):
        self.tape, self.place = tape, place

    @property
    def operation(self) -> Operation:
        """What computes it."""
        return self.tape.operations[self.place]

    @property
    def value(self) -> float | None:
        """What it is, where that is known now."""
        kind, operands = self.operation
        return operands[0] if kind == "constant" else None

    __add__, __radd__ = _with("add"), _with("add", True)
    __sub__, __rsub__ = _with("sub"), _with("sub", True)
    __mul__, __rmul__ = _with("mul"), _with("mul", True)
    __lt__, __gt__ = _with("less"), _with("less", True)

    def __truediv__(self, other: "Number | float") -> "Number":
        if not isinstance(other, Number):
            return self / self.tape.constant(other)
        return self * self.tape.apply("inverse", other)  # many divide by the same, and products are faster

    def __rtruediv__(self, other: float) -> "Number":
        return self.tape.constant(other) / self

    def __neg__(self) -> "Number":
        return self.tape.apply("neg", self)

    def __abs__(self) -> "Number":
        return self.tape.apply("abs", self)

    def __bool__(self) -> bool:
        raise TypeError("a symbol is neither true nor false: the physics chooses with where(), not with if")


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

    __add__, __radd__ = _by(np.add), _by(np.add, True)
    __sub__, __rsub__ = _by(np.subtract), _by(np.subtract, True)
    __mul__, __rmul__ = _by(np.multiply), _by(np.multiply, True)
    __truediv__, __rtruediv__ = _by(np.true_divide), _by(np.true_divide, True)
    __matmul__, __rmatmul__ = _by(np.matmul), _by(np.matmul, True)

    def __lt__(self, other: Any) -> "Symbols":
        return _elementwise("less", self, other)

    def __gt__(self, other: Any) -> "Symbols":
        return _elementwise("less", other, self)

    def __neg__(self) -> "Symbols":
        return _elementwise("neg", self)


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


NAMESPACE = SimpleNamespace(
    __name__="symbols",
    concat=_of(np.concatenate),
    stack=_of(np.stack),
    moveaxis=_of(np.moveaxis),
    permute_dims=_of(np.transpose),
    sum=_of(np.sum),
    linalg=SimpleNamespace(diagonal=_of(lambda a: np.diagonal(a, axis1=-2, axis2=-1))),
    zeros_like=lambda a: Symbols(np.zeros(a.shape)),
    ones_like=lambda a: Symbols(np.ones(a.shape)),
    asarray=lambda a, dtype=None, device=None: Symbols(np.asarray(a, float)),
    abs=lambda a: _elementwise("abs", a),
    sqrt=lambda a: _elementwise("sqrt", a),
    exp=lambda a: _elementwise("exp", a),
    where=lambda condition, a, b: _elementwise("where", condition, a, b),
)
