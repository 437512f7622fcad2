"""A fleet's steps by compiled code, on numpy arrays and on torch tensors of the CPU."""

from typing import Any

import numpy as np
import torch
from torch import Tensor

from auv_torchrl.physics.coefficients import ActiveTerms, Coefficients
from auv_torchrl.physics.kernel.adjoint import DifferentiableSteps
from auv_torchrl.physics.kernel.assembly import COUNTS, WORDS, array_names
from auv_torchrl.physics.kernel.recorded import Variant
from auv_torchrl.physics.kernel.steps import Steps
from auv_torchrl.physics.kernel.table import Memory, table
from auv_torchrl.physics.step import runge_kutta_steps

Array = Any


class Advance:
    """:func:`~auv_torchrl.physics.step.runge_kutta_steps` of vehicles whose coefficients stay in the same arrays.

    Gradients flow back through compiled code, too, to bodies, thrusts and targets. Where tensors are on another device
    or mapped over, or gradients by the vehicles are wanted, it is the plain one.
    """

    def __init__(self):
        self._read: tuple[Coefficients, float] | None = None
        self._steps: Steps | None = None
        self._calls: dict[tuple[int, bool], _Calls] = {}

    def forget(self) -> None:
        """Read the coefficients again: they were changed in place."""
        self._read = None

    def __call__(
        self,
        c: Coefficients,
        terms: ActiveTerms,
        body: Array,
        thrust: Array,
        targets: list[Array],
        time: Array,
        h: float,
    ) -> tuple[Array, Array]:
        """As of the plain one; arrays (N, ...)."""
        if isinstance(body, Tensor) and (
            _differentiated(time, *c) or not _plain_memory(body, thrust, time, *targets, *c)
        ):
            return runge_kutta_steps(c, terms, body, thrust, targets, time, h)
        steps = self._steps_of(c, terms, h)
        if not steps.compiled:
            return runge_kutta_steps(c, terms, body, thrust, targets, time, h)
        if isinstance(body, Tensor) and _differentiated(body, thrust, *targets):
            return DifferentiableSteps.apply(steps, body, thrust, torch.stack(targets, dim=-2), time)
        one = all(target is targets[0] for target in targets)
        goals = np.asarray(targets[0])[:, None] if one else np.stack([np.asarray(each) for each in targets], axis=-2)
        given = (np.asarray(array) for array in (body, thrust, goals, time))
        later = self._calls_of(steps, len(targets), one).run(*given)
        if isinstance(body, Tensor):
            return torch.from_numpy(later[0]), torch.from_numpy(later[1])
        return later

    def _steps_of(self, c: Coefficients, terms: ActiveTerms, h: float) -> Steps:
        if self._steps is None or self._read is None or self._read[0] is not c or self._read[1] != h:
            known = c.numpy() if isinstance(c.lag, Tensor) else c
            self._steps, self._read = Steps(known, terms, h, Variant.of(known)), (c, h)
            self._calls.clear()
        return self._steps

    def _calls_of(self, steps: Steps, parts: int, one: bool) -> "_Calls":
        if (parts, one) not in self._calls:
            self._calls[parts, one] = _Calls(steps, parts, one)
        return self._calls[parts, one]


class _Calls:
    """Calls of compiled steps that differ in nothing but where their arrays lie.

    Args:
        steps: of vehicles (R,).
        parts: Runge-Kutta steps of a call.
        one: whether all have the same targets.
    """

    def __init__(self, steps: Steps, parts: int, one: bool):
        self._steps, dtype = steps, steps.dtype
        rows, thrusters = steps.c.full_thrust.shape
        self._shapes = {
            "body": (rows, 13), "thrust": (rows, thrusters), "time": (rows,),
            "target": (rows, 1 if one else parts, thrusters),
        }  # fmt: skip
        self._scratch = np.empty((rows, 13), dtype)
        rows_of = {name: np.empty((1, *shape), dtype) for name, shape in self._shapes.items()}
        arrays = {
            "constants": steps.constants,
            **rows_of,
            "time": rows_of["time"][..., None],
            "target": rows_of["target"][:, :, None],
            "force": np.zeros((1, 1, 1, 6), dtype),
            "states": self._scratch[None, :, None],
            "final body": rows_of["body"],
            "final thrust": rows_of["thrust"],
            "final time": np.empty((1, rows, 1), dtype),
        }
        self._kept = arrays  # what no call replaces
        memory = Memory(rows, steps.kept, dtype)
        self._memory = memory
        self._words = table(steps.layout, arrays, (1, rows, 1, parts), memory)
        names = array_names(steps.layout)
        self._places = {name: COUNTS + WORDS * place for place, name in enumerate(names)}

    def run(self, body: Array, thrust: Array, target: Array, time: Array) -> tuple[Array, Array]:
        """Body (R, 13) and thrust (R, n) afterwards; the target is (R, 1, n) or (R, P, n), the time (R,)."""
        given = {"body": body, "thrust": thrust, "target": target, "time": time}
        given = {name: np.ascontiguousarray(array, self._steps.dtype) for name, array in given.items()}
        for name, array in given.items():
            if array.shape != self._shapes[name]:
                raise ValueError(f"{name} must have the shape {self._shapes[name]}, and has {array.shape}")
        body_later, thrust_later = np.empty_like(given["body"]), np.empty_like(given["thrust"])
        for name, array in (*given.items(), ("final body", body_later), ("final thrust", thrust_later)):
            self._words[self._places[name]] = array.ctypes.data
        self._steps.call(self._words)
        return body_later, thrust_later


def _plain_memory(*tensors: Tensor) -> bool:
    """Whether tensors are on the CPU and not mapped over."""
    return not torch.compiler.is_compiling() and all(
        tensor.device.type == "cpu" and not torch._C._functorch.is_functorch_wrapped_tensor(tensor)  # pyright: ignore[reportAttributeAccessIssue]
        for tensor in tensors
    )


def _differentiated(*tensors: Tensor) -> bool:
    return torch.is_grad_enabled() and any(tensor.requires_grad for tensor in tensors)
