"""A traced computation, cut into what is worked out once per vehicle and what is worked out at every step."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate

from auv_torchrl.physics.kernel.symbols import Operation, Symbols, Tape


@dataclass(frozen=True)
class Layout:
    """The arrays of a kernel, by name, with the numbers that each holds per row; ``table.py`` says their axes."""

    constants: dict[str, int]  # of a vehicle; they are read once
    carried: dict[str, int]  # read at the first step, and each step leaves them to the next
    given: dict[str, int]  # read at every step
    written: dict[str, int]  # written after every step; those that are carried, too, after the last one alone


@dataclass(frozen=True)
class Program:
    """Straight lines of operations; each number is computed before it is used."""

    layout: Layout
    operations: Sequence[Operation]
    before: Sequence[int]  # places of the operations on constants alone, in order
    kept: Sequence[int]  # of those, and of the constants, what the steps need
    steps: Sequence[int]  # places of the other operations
    outputs: Mapping[str, Sequence[int]]  # places of what is carried on or written


def program(tape: Tape, layout: Layout, outputs: dict[str, Symbols]) -> Program:
    """Drop what no output needs, and part the rest."""
    places = {name: [number.place for number in array.numbers.flat] for name, array in outputs.items()}
    live = _needed(tape.operations, (place for some in places.values() for place in some))
    constant = _constant(tape.operations, layout)
    operations = tape.operations
    needed = {operand for place in live - constant for operand in operands(operations[place])} & constant
    needed |= {place for some in places.values() for place in some} & constant
    truths = {place for place in needed if operations[place].kind == "less"}  # truths are not stored, but found again
    needed |= {operand for place in truths for operand in operands(operations[place])}
    kept = [place for place in sorted(needed - truths) if operations[place].kind != "constant"]
    return Program(
        layout=layout,
        operations=operations,
        before=[place for place in sorted(live & constant) if operations[place].kind != "constant"],
        kept=kept,
        steps=[place for place in sorted((live - constant) | truths) if operations[place].kind != "constant"],
        outputs=places,
    )


def operands(operation: Operation) -> tuple[int, ...]:
    """Places of the numbers that an operation reads."""
    return () if operation.kind in ("input", "constant") else operation.operands


def _needed(operations: Sequence[Operation], outputs: Iterable[int]) -> set[int]:
    needed: set[int] = set()
    pending = list(outputs)
    while pending:
        place = pending.pop()
        if place not in needed:
            needed.add(place)
            pending += operands(operations[place])
    return needed


def _constant(operations: Sequence[Operation], layout: Layout) -> set[int]:
    constant: set[int] = set()
    for place, operation in enumerate(operations):
        if operation.kind == "input":
            known = operation.operands[0] in layout.constants
        else:
            known = all(operand in constant for operand in operands(operation))
        if known:
            constant.add(place)
    return constant


def offsets(sizes: dict[str, int]) -> dict[str, int]:
    """Where each array begins when they stand one after another."""
    ends = accumulate(sizes.values(), initial=0)
    return dict(zip(sizes, ends, strict=False))
