"""Many Runge-Kutta steps of many vehicles over many windows in one call of compiled code."""

from typing import Any

import numpy as np

from auv_torchrl.physics.coefficients import ActiveTerms, Coefficients
from auv_torchrl.physics.kernel.native import Code, is_wanted
from auv_torchrl.physics.kernel.program import Layout, Program, program
from auv_torchrl.physics.kernel.recorded import Shapes, Variant, code_of, constants, recorded_coefficients, sizes_of
from auv_torchrl.physics.kernel.symbols import Symbols, Tape
from auv_torchrl.physics.kernel.table import readable, table
from auv_torchrl.physics.step import runge_kutta_step

Array = np.ndarray[Any, np.dtype[Any]]


class Steps:
    """Vehicles (R,) of which :func:`~auv_torchrl.physics.step.runge_kutta_step` is run again and again.

    The compiled step has all terms: one for vehicles of as many thrusters, whatever they do, and one more at a surface;
    or those of a variant.
    """

    def __init__(self, c: Coefficients, terms: ActiveTerms, h: float, variant: Variant | None = None):
        """Read the coefficients once.

        Args:
            c: (R, ...), numpy, in the precision that is computed in, double or single.
            terms: of them.
            h: length of a Runge-Kutta step in s.
            variant: that does all that the vehicles need; None for all terms.
        """
        self.c, self.terms, self.h = c, terms, h
        self.shapes = tuple(field.shape[1:] for field in c)
        self.dtype = c.lag.dtype
        self.layout = _layout(self.shapes)
        variant = variant or Variant.full(terms)
        self._run = code_of(traced_step, self.shapes, variant, 8 * self.dtype.itemsize) if is_wanted() else None
        if self._run is not None:
            self.constants = constants(c, self.dtype, (h,))

    @property
    def compiled(self) -> bool:
        """Whether compiled code runs, not numpy."""
        return self._run is not None

    @property
    def code(self) -> Code:
        """What runs then."""
        assert self._run is not None
        return self._run

    def run(
        self, body: Array, thrust: Array, targets: Array, time: Array, force: Array | None = None
    ) -> tuple[Array, Array]:
        """States (W, R, S + 1, 13) from ``body`` on, one after each step, and the last thrust (W, R, n).

        Args:
            body: (W, R, 13) position, quaternion and velocity before the first step.
            thrust: (W, R, n) in N.
            targets: (W, R, S, P, n) in N; each of the ``S`` steps is ``P`` Runge-Kutta steps.
            time: (W, R) in s since the start of the episode.
            force: (W, R, S, 6) in N and N m, body frame, that acts besides the thrusters; None for none.

        One in an axis stands for all; the axis of the vehicles may be longer than there are coefficients where there
        is one vehicle.
        """
        force = np.zeros((1, 1, 1, 6), self.dtype) if force is None else force
        vehicles = (1, len(self.c.full_thrust))
        windows, rows = np.broadcast_shapes(
            vehicles, *(given.shape[:2] for given in (body, thrust, targets, time, force))
        )
        steps = targets.shape[2]
        shape = (windows, rows, steps, targets.shape[3])
        if not windows * rows * steps:
            states = np.broadcast_to(body[:, :, None], (windows, rows, steps + 1, 13))
            return states, np.broadcast_to(thrust, (windows, rows, thrust.shape[-1]))
        call = self._by_machine if self.compiled else self._by_numpy
        return call(shape, body, thrust, targets, time, force)

    def _by_machine(
        self, shape: tuple[int, int, int, int], body: Array, thrust: Array, targets: Array, time: Array, force: Array
    ) -> tuple[Array, Array]:
        windows, rows, steps, _ = shape
        dtype = self.dtype
        states = np.empty((windows, rows, steps + 1, 13), dtype)
        states[:, :, 0] = body
        later = np.empty((windows, rows, thrust.shape[-1]), dtype)
        arrays = {
            "constants": self.constants,
            "body": readable(body, dtype),
            "thrust": readable(thrust, dtype),
            "time": readable(time[..., None], dtype),
            "target": readable(targets, dtype),
            "force": readable(force, dtype),
            "states": states[:, :, 1:],
            "final body": np.empty((windows, rows, 13), dtype),
            "final thrust": later,
            "final time": np.empty((windows, rows, 1), dtype),
        }
        self.code(table(self.layout, arrays, shape).ctypes.data)
        return states, later

    def _by_numpy(
        self, shape: tuple[int, int, int, int], body: Array, thrust: Array, targets: Array, time: Array, force: Array
    ) -> tuple[Array, Array]:
        windows, rows, steps, parts = shape
        states = np.empty((windows, rows, steps + 1, 13), self.dtype)
        states[:, :, 0] = body
        body = _by_number(np.broadcast_to(body, (windows, rows, 13)))
        for step in range(steps):
            pushed = _by_number(force[:, :, min(step, force.shape[2] - 1)])
            for part in range(parts):
                target = targets[:, :, step, part]
                body, thrust = runge_kutta_step(self.c, self.terms, body, thrust, target, time, self.h, pushed)
                time = time + self.h
            states[:, :, step + 1] = body
        return states, np.broadcast_to(thrust, (windows, rows, thrust.shape[-1]))


def _by_number(rows: Array) -> Array:
    """The same rows (w, R, k) with each number of all rows in one piece of memory, where numpy is twice as fast."""
    return np.ascontiguousarray(rows.transpose(2, 0, 1)).transpose(1, 2, 0)


def _layout(shapes: Shapes) -> Layout:
    sizes = sizes_of(shapes)
    thrusters = sizes["full_thrust"]
    return Layout(
        constants={**sizes, "h": 1},
        carried={"body": 13, "thrust": thrusters, "time": 1},
        given={"target": thrusters, "force": 6},
        written={"states": 13},
    )


def traced_step(shapes: Shapes, variant: Variant) -> Program:
    """A Runge-Kutta step of vehicles whose coefficients have these shapes."""
    tape, layout = Tape(), _layout(shapes)
    c = recorded_coefficients(tape, shapes, variant)
    body, thrust, target, force = (
        tape.inputs(name, (size,)) for name, size in (layout.carried | layout.given).items() if name != "time"
    )
    time, h = tape.inputs("time", ()), tape.inputs("h", ())
    step: Any = runge_kutta_step  # on a third array library
    body, thrust = step(c, variant.terms, body, thrust, target, time, h, force)
    return program(tape, layout, {"body": body, "thrust": thrust, "time": time + h, "states": Symbols(body.numbers)})
