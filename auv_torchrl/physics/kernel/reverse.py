"""The vector-Jacobian product of a recorded computation, recorded on the same tape (Griewank and Walther 2008, 3.2)."""

from collections.abc import Iterator, Sequence
from typing import cast

import numpy as np

from auv_torchrl.physics.kernel.program import operands
from auv_torchrl.physics.kernel.symbols import Number, Symbols, Tape


def pulled_back(
    tape: Tape, outputs: Sequence[Symbols], weights: Sequence[Symbols], inputs: Sequence[Symbols]
) -> list[Symbols]:
    """Gradients of the sum of outputs times weights, shaped as the inputs.

    Args:
        tape: on which the outputs were computed; the gradients are recorded behind them.
        outputs: any arrays of the tape.
        weights: one for each output, of its shape, computed or given before this call.
        inputs: what is differentiated by; arrays that the tape was given.

    A choice counts as made (``where``), and ``abs`` has the slope 1 at zero.
    """
    end = len(tape.operations)
    moving = _depending(tape, inputs)
    slopes: dict[int, Number] = {}

    def add(place: int, slope: Number) -> None:
        if place in moving:
            slopes[place] = slopes[place] + slope if place in slopes else slope

    for output, weight in zip(outputs, weights, strict=True):
        for number, share in zip(output.numbers.flat, weight.numbers.flat, strict=True):
            add(number.place, share)
    for place in range(end - 1, -1, -1):
        if place in slopes and tape.operations[place].kind != "input":
            for operand, slope in _shares(Number(tape, place), slopes[place]):
                add(operand, slope)
    return [_found(tape, given, slopes) for given in inputs]


def _shares(result: Number, slope: Number) -> Iterator[tuple[int, Number]]:
    """What each operand of an operation gets of the slope of its result."""
    kind, places = result.operation
    given = [Number(result.tape, place) for place in places]
    zero = result.tape.constant(0.0)
    if kind == "where":
        truth, chosen, other = given
        yield chosen.place, result.tape.apply("where", truth, slope, zero)
        yield other.place, result.tape.apply("where", truth, zero, slope)
        return
    by_operand = {
        "add": lambda: (slope, slope),
        "sub": lambda: (slope, -slope),
        "mul": lambda: (slope * given[1], slope * given[0]),
        "inverse": lambda: (-(slope * (result * result)),),
        "neg": lambda: (-slope,),
        "abs": lambda: (result.tape.apply("where", given[0] < 0.0, -slope, slope),),
        "sqrt": lambda: (slope * (0.5 / result),),
        "exp": lambda: (slope * result,),
        "sin": lambda: (slope * result.tape.apply("cos", given[0]),),
        "cos": lambda: (-(slope * result.tape.apply("sin", given[0])),),
        "less": lambda: (),
    }
    if kind not in by_operand:
        raise ValueError(f"no derivative of {kind!r}: give it one here")
    for operand, share in zip(given, by_operand[kind](), strict=kind != "less"):
        yield operand.place, share


def _depending(tape: Tape, inputs: Sequence[Symbols]) -> set[int]:
    """Places of the numbers that depend on some of the inputs."""
    moving = {number.place for given in inputs for number in given.numbers.flat}
    for place, operation in enumerate(tape.operations):
        if any(operand in moving for operand in operands(operation)):
            moving.add(place)
    return moving


def _found(tape: Tape, given: Symbols, slopes: dict[int, Number]) -> Symbols:
    numbers = np.empty(given.shape, object)
    for index in np.ndindex(given.shape):
        numbers[index] = slopes.get(cast(Number, given.numbers[index]).place, tape.constant(0.0))
    return Symbols(numbers)
