"""Accelerations of many vehicles along motions that are known, in one call of compiled code."""

from functools import cache
from typing import Any, cast

import numpy as np

from auv_torchrl.physics.coefficients import ActiveTerms, Coefficients
from auv_torchrl.physics.fins import fin_wrench
from auv_torchrl.physics.hydrodynamics import acceleration
from auv_torchrl.physics.kernel.native import is_wanted
from auv_torchrl.physics.kernel.program import Layout, Program, program
from auv_torchrl.physics.kernel.recorded import Shapes, Variant, code_of, constants, recorded_coefficients, sizes_of
from auv_torchrl.physics.kernel.symbols import Symbols, Tape
from auv_torchrl.physics.kernel.table import readable, table
from auv_torchrl.physics.kinematics import rotation_matrix
from auv_torchrl.physics.surface import given_in_water
from auv_torchrl.physics.thrusters import body_wrench

Array = np.ndarray[Any, np.dtype[Any]]


def rates(c: Coefficients, terms: ActiveTerms, states: Array, thrust: Array, time: Array) -> Array:
    """Rates (W, R, S, 6) of the body velocities of vehicles (R,), in m/s^2 and rad/s^2.

    Args:
        c: (R, ...), numpy, double precision.
        terms: of them.
        states: (W, R, S, 13) position, quaternion of unit length and velocity.
        thrust: (W, R, S, n) in N, before gains.
        time: (W, R, S) in s since the start of the episode.

    One in an axis of the states, the thrust or the time stands for all.
    """
    vehicles = (1, len(c.full_thrust), 1)
    shape = cast(
        tuple[int, int, int],
        np.broadcast_shapes(vehicles, states.shape[:3], thrust.shape[:3], time.shape),
    )
    shapes = tuple(field.shape[1:] for field in c)
    run = code_of(traced_rate, shapes, Variant.full(terms)) if is_wanted() and 0 not in shape else None
    if run is None:
        by_step = c.rows((slice(None), None))  # (R, 1, ...) so that steps are a batch axis
        rate = _rate(by_step, terms, states, thrust, time)
        return np.broadcast_to(rate, (*shape, 6))
    found = np.empty((*shape, 6))
    arrays = {
        "constants": constants(c, np.float64),
        "states": readable(states, np.float64),
        "thrust": readable(thrust, np.float64),
        "time": readable(time[..., None], np.float64),
        "rate": found,
    }
    run(table(_layout(shapes), arrays, (*shape, 1)).ctypes.data)
    return found


def _rate(c: Coefficients, terms: ActiveTerms, state: Any, thrust: Any, time: Any) -> Any:
    rotation = rotation_matrix(state[..., 3:7])
    wrench = body_wrench(c, terms, given_in_water(c, terms, thrust, rotation, state[..., :3]), time)
    if terms.fins:
        wrench = wrench + fin_wrench(c, terms, rotation, state[..., :3], state[..., 7:], thrust)
    if isinstance(state, np.ndarray):
        state = np.broadcast_to(state, (*wrench.shape[:-1], state.shape[-1]))
    return acceleration(c, terms, rotation, state[..., :3], state[..., 7:], wrench)


@cache
def _layout(shapes: Shapes) -> Layout:
    sizes = sizes_of(shapes)
    given = {"states": 13, "thrust": sizes["full_thrust"], "time": 1}
    return Layout(constants=sizes, carried={}, given=given, written={"rate": 6})


def traced_rate(shapes: Shapes, variant: Variant) -> Program:
    """The acceleration with the terms of a variant, of vehicles whose coefficients have these shapes."""
    tape, layout = Tape(), _layout(shapes)
    c = recorded_coefficients(tape, shapes)
    state, thrust = (tape.inputs(name, (layout.given[name],)) for name in ("states", "thrust"))
    rate: Symbols = _rate(c, variant.terms, state, thrust, tape.inputs("time", ()))
    return program(tape, layout, {"rate": rate})
