"""The force on free bodies as a C function that MuJoCo calls at each stage of its integrator."""

from functools import cache
from typing import Any

import numpy as np

from auv_torchrl.physics.coefficients import Coefficients
from auv_torchrl.physics.free_body import free_body_force
from auv_torchrl.physics.kernel.assembly import COUNTS, STEP, WORDS, array_names
from auv_torchrl.physics.kernel.native import is_wanted
from auv_torchrl.physics.kernel.program import Layout, Program, program
from auv_torchrl.physics.kernel.recorded import Shapes, Variant, code_of, constants, recorded_coefficients, sizes_of
from auv_torchrl.physics.kernel.symbols import NAMESPACE, Tape
from auv_torchrl.physics.kernel.table import Memory, table

Array = np.ndarray[Any, np.dtype[Any]]


class Forces:
    """:func:`~auv_torchrl.physics.free_body.free_body_force` of vehicles (R,), on arrays that stay where they are."""

    def __init__(self, c: Coefficients, inertia: Array, fastest: float, bodies: dict[str, Array]):
        """Read the coefficients once.

        Args:
            c: (R, ...), numpy, double precision.
            inertia: (6,) of the bodies.
            fastest: m/s^2 and rad/s^2, from which a body has diverged.
            bodies: ``position`` (R, 3), ``rate`` (R, 6) and ``rotation`` (R, 9), read at every call, and ``lost``
                (R, 1) and ``body force`` (R, 6), written; a lost body is 1 from then on.
        """
        rows, variant, shapes = len(c.lag), Variant.of(c), tuple(field.shape[1:] for field in c)
        # thrusters that leave the water, and fins, push otherwise wherever the body is, and not as known beforehand
        fits = is_wanted() and variant not in (Variant.SURFACE, Variant.FINS, Variant.AZIMUTH)
        self._code = code_of(traced_force, shapes, variant) if fits else None
        if self._code is None:
            return
        arrays = {
            "constants": constants(c, np.float64, (*inertia, fastest)),
            **{name: array[None, :, None] for name, array in bodies.items()},
            "seen lost": bodies["lost"][None, :, None],
            "wrench": np.empty((1, rows, 1, 6)),
        }
        self._arrays, self._memory = arrays, Memory(rows, self._code.kept, np.float64)
        self._table = table(_layout(shapes), arrays, (1, rows, 1, 1), self._memory)
        self._wrench = COUNTS + WORDS * array_names(_layout(shapes)).index("wrench")

    @property
    def compiled(self) -> bool:
        """Whether there is such a function."""
        return self._code is not None

    def callback(self, wrench: Array) -> Any:
        """A C function that puts the forces into their array at each call; good until other forces give theirs.

        Args:
            wrench: (S, R, 6) in N and N m, from the thrusters at each of S calls, or the same at all where S is 1.
        """
        assert self._code is not None
        self._arrays["wrench"] = wrench = np.ascontiguousarray(wrench)
        self._table[self._wrench] = wrench.ctypes.data
        self._table[self._wrench + STEP] = wrench.strides[0] if len(wrench) > 1 else 0
        return self._code.callback(self._table.ctypes.data, self)


@cache
def _layout(shapes: Shapes) -> Layout:
    given = {"position": 3, "rate": 6, "rotation": 9, "seen lost": 1, "wrench": 6}
    read = {**sizes_of(shapes), "inertia": 6, "fastest": 1}
    return Layout(constants=read, carried={}, given=given, written={"body force": 6, "lost": 1})


def traced_force(shapes: Shapes, variant: Variant) -> Program:
    """The force on bodies of vehicles whose coefficients have these shapes."""
    tape, layout = Tape(), _layout(shapes)
    c = recorded_coefficients(tape, shapes, variant)
    position, rate, rotation, wrench = (
        tape.inputs(name, (layout.given[name],)) for name in ("position", "rate", "rotation", "wrench")
    )
    inertia, fastest = tape.inputs("inertia", (6,)), tape.inputs("fastest", ())
    call: Any = free_body_force  # on a third array library
    force, sane = call(c, variant.terms, inertia, fastest, position, rate, rotation.reshape(3, 3), wrench)
    lost = NAMESPACE.where(sane, tape.inputs("seen lost", ()), 1.0)
    return program(tape, layout, {"body force": force, "lost": lost})
