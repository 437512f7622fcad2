"""The straight-line program that physics run on symbols leaves behind.

Equal expressions are computed once, constants are folded, and what adds zero or multiplies by one is left out.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

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
    "sin": math.sin,
    "cos": math.cos,
    "tanh": math.tanh,
    "atan2": math.atan2,
    "round": lambda a: float(np.round(a)),
    "less": lambda a, b: float(a < b),
    "where": lambda condition, a, b: a if condition else b,
}


class Operation(NamedTuple):
    """One number of a program: an input (``name`` and place), a constant, or an operation on earlier numbers."""

    kind: str  # "input", "constant" or a key of the table above
    operands: tuple[Any, ...]


class Recorder:
    """The program that is being recorded, in the order of computation."""

    def __init__(self):
        self.operations: list[Operation] = []
        self._known: dict[Operation, int] = {}

    def constant(self, value: float) -> "Number":
        """A number that is known now."""
        return self._record(Operation("constant", (float(value),)))

    def input(self, name: str, place: int) -> "Number":
        """A number that the program is given: the one at a place of an array."""
        return self._record(Operation("input", (name, place)))

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

    def __init__(self, tape: Recorder, place: int):
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

    def __pow__(self, exponent: int) -> "Number":
        if exponent != 2:
            raise TypeError(f"a symbol to the power of {exponent}: squares alone are known")
        return self * self

    def __neg__(self) -> "Number":
        return self.tape.apply("neg", self)

    def __abs__(self) -> "Number":
        return self.tape.apply("abs", self)

    def __bool__(self) -> bool:
        raise TypeError("a symbol is neither true nor false: the physics chooses with where(), not with if")
