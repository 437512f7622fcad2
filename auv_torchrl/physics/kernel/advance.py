"""A fleet's steps by compiled code, on numpy arrays and on torch tensors of the CPU."""

from typing import Any

import numpy as np
import torch
from torch import Tensor

from auv_torchrl.physics.coefficients import ActiveTerms, Coefficients
from auv_torchrl.physics.kernel.adjoint import DifferentiableSteps
from auv_torchrl.physics.kernel.steps import Steps
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
        parts = np.asarray(targets[0])[:, None] if one else np.stack([np.asarray(each) for each in targets], axis=-2)
        parts = np.broadcast_to(parts, (len(parts), len(targets), parts.shape[-1]))[None, :, None]
        states, later = steps.run(np.asarray(body)[None], np.asarray(thrust)[None], parts, np.asarray(time)[None])
        body_later, thrust_later = states[0, :, 1], later[0]
        if isinstance(body, Tensor):
            return torch.from_numpy(body_later), torch.from_numpy(thrust_later)
        return body_later, thrust_later

    def _steps_of(self, c: Coefficients, terms: ActiveTerms, h: float) -> Steps:
        if self._steps is None or self._read is None or self._read[0] is not c or self._read[1] != h:
            self._steps, self._read = Steps(c.numpy() if isinstance(c.lag, Tensor) else c, terms, h), (c, h)
        return self._steps


def _plain_memory(*tensors: Tensor) -> bool:
    """Whether tensors are on the CPU and not mapped over."""
    return not torch.compiler.is_compiling() and all(
        tensor.device.type == "cpu" and not torch._C._functorch.is_functorch_wrapped_tensor(tensor)  # pyright: ignore[reportAttributeAccessIssue]
        for tensor in tensors
    )


def _differentiated(*tensors: Tensor) -> bool:
    return torch.is_grad_enabled() and any(tensor.requires_grad for tensor in tensors)
