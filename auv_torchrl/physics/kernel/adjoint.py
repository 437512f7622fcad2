"""Runge-Kutta steps that gradients flow back through: compiled forwards and backwards, as one function of torch."""

from functools import cache
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from auv_torchrl.physics.kernel.native import Code
from auv_torchrl.physics.kernel.program import Layout, Program, program
from auv_torchrl.physics.kernel.recorded import Shapes, Variant, code_of, recorded_coefficients, sizes_of
from auv_torchrl.physics.kernel.reverse import pulled_back
from auv_torchrl.physics.kernel.steps import Steps
from auv_torchrl.physics.kernel.symbols import Symbols, Tape
from auv_torchrl.physics.kernel.table import readable, table
from auv_torchrl.physics.step import runge_kutta_step
from auv_torchrl.physics.thrusters import thrust_after

Array = np.ndarray[Any, np.dtype[Any]]


class DifferentiableSteps(torch.autograd.Function):
    """``apply(steps, body, thrust, targets, time)``: body (N, 13) and thrust (N, n) after P steps, on the CPU.

    The targets are (N, P, n). Gradients reach body, thrust and targets, not the time and not the vehicles.
    """

    @staticmethod
    def forward(
        ctx: Any, steps: Steps, body: Tensor, thrust: Tensor, targets: Tensor, time: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Step, and keep the states between."""
        goals = targets.detach().numpy()[None, :, :, None]
        states, later = steps.run(body.detach().numpy()[None], thrust.detach().numpy()[None], goals, time.numpy()[None])
        ctx.steps, ctx.states = steps, states
        ctx.save_for_backward(thrust, targets, time)
        return torch.from_numpy(states[0, :, -1].copy()), torch.from_numpy(later[0])

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *grad_outputs: Any) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The gradients, from those of what came out."""
        thrust, targets, time = (saved.detach().numpy() for saved in ctx.saved_tensors)
        given = (slope.contiguous().numpy() for slope in grad_outputs)
        found = _gradients(ctx.steps, ctx.states[0], thrust, targets, time, *given)
        return (None, *(torch.from_numpy(slope) for slope in found), None)


def _gradients(
    steps: Steps, states: Array, thrust: Array, targets: Array, time: Array, body_slope: Array, thrust_slope: Array
) -> tuple[Array, Array, Array]:
    """Gradients by the first body (R, 13), the first thrust (R, n) and the targets (R, S, n) of compiled steps.

    Args:
        steps: of the vehicles.
        states: (R, S + 1, 13) before the first step and after each.
        thrust: (R, n) in N, before the first step.
        targets: (R, S, n) in N.
        time: (R,) in s, before the first step.
        body_slope: (R, 13) gradient by the last state.
        thrust_slope: (R, n) gradient by the last thrust.
    """
    dtype = steps.dtype
    rows, count, thrusters = targets.shape
    thrusts = [thrust]  # before each step
    for step in range(count - 1):
        thrusts.append(thrust_after(steps.c, steps.terms, thrusts[-1], targets[:, step], steps.h))
    times = time[:, None, None] + steps.h * np.arange(count)[:, None]
    by_target = np.empty((rows, count, thrusters), dtype)
    by_body, by_thrust = np.empty((rows, 13), dtype), np.empty((rows, thrusters), dtype)
    backwards = {"body": states[:, :-1], "thrust": np.stack(thrusts, axis=1), "target": targets, "time": times}
    arrays = {
        "constants": steps.constants,
        "body slope": readable(body_slope, dtype)[None],
        "thrust slope": readable(thrust_slope, dtype)[None],
        **{name: readable(array, dtype)[None, :, ::-1] for name, array in backwards.items()},
        "target slope": by_target[None, :, ::-1],
        "final body slope": by_body[None],
        "final thrust slope": by_thrust[None],
    }
    run = cast(Code, code_of(traced_adjoint, steps.shapes, Variant.full(steps.terms), 8 * dtype.itemsize))
    run(table(_layout(steps.shapes), arrays, (1, rows, count, 1)).ctypes.data)
    return by_body, by_thrust, by_target


@cache
def _layout(shapes: Shapes) -> Layout:
    sizes = sizes_of(shapes)
    thrusters = sizes["full_thrust"]
    return Layout(
        constants={**sizes, "h": 1},
        carried={"body slope": 13, "thrust slope": thrusters},
        given={"body": 13, "thrust": thrusters, "target": thrusters, "time": 1},
        written={"target slope": thrusters},
    )


def traced_adjoint(shapes: Shapes, variant: Variant) -> Program:
    """The vector-Jacobian product of a Runge-Kutta step with the terms of a variant."""
    tape, layout = Tape(), _layout(shapes)
    c = recorded_coefficients(tape, shapes)
    sizes = layout.given | layout.carried
    body, thrust, target, *slopes = (
        tape.inputs(name, (sizes[name],)) for name in ("body", "thrust", "target", "body slope", "thrust slope")
    )
    time, h = tape.inputs("time", ()), tape.inputs("h", ())
    step: Any = runge_kutta_step  # on a third array library
    later: tuple[Symbols, Symbols] = step(c, variant.terms, body, thrust, target, time, h)
    by_body, by_thrust, by_target = pulled_back(tape, later, slopes, (body, thrust, target))
    return program(tape, layout, {"body slope": by_body, "thrust slope": by_thrust, "target slope": by_target})
