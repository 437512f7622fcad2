"""A function of rows, written on the array API, as one call of compiled code."""

import hashlib
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from array_api_compat import array_namespace, is_torch_array

from auv_torchrl.physics.coefficients import ActiveTerms, Coefficients
from auv_torchrl.physics.kernel.assembly import assembly
from auv_torchrl.physics.kernel.native import Code, is_wanted, load
from auv_torchrl.physics.kernel.program import Layout, program
from auv_torchrl.physics.kernel.symbols import Symbols, Tape
from auv_torchrl.physics.kernel.table import Call
from auv_torchrl.physics.thrusters import limited_thrust, thrust_targets

Array = Any
_NO_CONSTANTS = {"nothing": 1}  # a kernel reads one at least


class RowFunction:
    """A function of arrays (N, k), or (N,) where k is 0, to one array (N, m), or (N,), traced and compiled once.

    Args:
        name: of its machine code.
        function: on the array API; what it does depends on shapes alone, not on values.
        given: k of each of its arguments, in order.
    """

    def __init__(self, name: str, function: Callable[..., Array], given: dict[str, int]):
        self.name, self.function, self.given = name, function, given
        self._traced: tuple[Tape, Layout, Symbols] | None = None
        self._codes: dict[int, Code | None] = {}  # by bits

    def traced(self) -> tuple[Tape, Layout, Symbols]:
        """What it computes, its arrays, and the symbols that it gives."""
        if self._traced is None:
            tape = Tape()
            inputs = (tape.inputs(name, (size,) if size else ()) for name, size in self.given.items())
            found: Symbols = self.function(*inputs)
            given = {name: max(size, 1) for name, size in self.given.items()}
            layout = Layout(constants=_NO_CONSTANTS, carried={}, given=given, written={"found": found.numbers.size})
            self._traced = tape, layout, found
        return self._traced

    def code(self, bits: int) -> Code | None:
        """Its machine code in a precision; None where there is none."""
        if bits not in self._codes:
            tape, layout, found = self.traced()
            text = assembly(program(tape, layout, {"found": found}), bits)
            digest = hashlib.sha256(text.encode()).hexdigest()[:16]  # its source is not that of the physics alone
            self._codes[bits] = load(f"{self.name}-{bits}-{digest}", lambda: text)
        return self._codes[bits]


class ByRow:
    """Calls of one caller of a :class:`RowFunction`, on numpy or torch; callers in several threads need one each."""

    def __init__(self, function: RowFunction):
        self._of = function
        self._calls: dict[tuple[int, int], Call] = {}  # by rows and bits

    def __call__(self, *arrays: Array) -> Array:
        """As of the function; arrays that compiled code cannot read are given to the function itself."""
        first, readable, is_torch = arrays[0], True, is_torch_array(arrays[0])
        if is_torch:
            from auv_torchrl.physics.kernel.tensors import differentiated, in_plain_memory  # here: numpy needs none

            readable = in_plain_memory(*arrays) and not differentiated(*arrays)
        call = self._call_of(len(first), 8 * first.dtype.itemsize) if readable and is_wanted() and len(first) else None
        if call is None:
            return self._of.function(*arrays)
        dtype = np.asarray(first[:0]).dtype
        given = {name: np.ascontiguousarray(array, dtype) for name, array in zip(self._of.given, arrays, strict=True)}
        found = np.empty((len(first), *self._of.traced()[2].shape), dtype)
        call.run({**given, "found": found})
        return array_namespace(first).asarray(found) if is_torch else found

    def _call_of(self, rows: int, bits: int) -> Call | None:
        code = self._of.code(bits)
        if code is not None and (rows, bits) not in self._calls:
            layout = self._of.traced()[1]
            dtype = np.dtype(f"f{bits // 8}")
            sizes = {**layout.given, **layout.written}
            arrays = {name: np.empty((1, rows, 1, size), dtype) for name, size in sizes.items()}
            constants = {"constants": np.zeros((1, 1, 1), dtype)}
            self._calls[rows, bits] = Call(code, layout, {**constants, **arrays}, (1, rows, 1, 1))
        return self._calls.get((rows, bits))


class Targets:
    """:func:`~auv_torchrl.physics.thrusters.thrust_targets`; compiled where thrust only follows the command just sent.

    Args:
        thrusters: of a vehicle.
    """

    def __init__(self, thrusters: int):
        self._limited = ByRow(_limited(thrusters))

    def __call__(
        self, c: Coefficients, terms: ActiveTerms, commands: Array, control_dt: float, stretches: int
    ) -> list[Array]:
        """As of the function."""
        if commands.shape[-2] > 1 or terms.routing or terms.curve:
            return thrust_targets(c, terms, commands, control_dt, stretches)
        return [self._limited(commands[..., 0, :], c.full_thrust, c.limit, c.dead_band)] * stretches


@cache
def _limited(thrusters: int) -> RowFunction:
    given = ("command", "full_thrust", "limit", "dead_band")
    return RowFunction("thrust", limited_thrust, dict.fromkeys(given, thrusters))
