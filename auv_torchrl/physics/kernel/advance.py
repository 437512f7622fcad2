"""A fleet's steps by compiled code, on numpy arrays and on torch tensors of the CPU."""

from typing import Any

import numpy as np
from array_api_compat import is_torch_array

from auv_torchrl.physics.coefficients import ActiveTerms, Coefficients
from auv_torchrl.physics.kernel.recorded import Variant
from auv_torchrl.physics.kernel.steps import Steps
from auv_torchrl.physics.kernel.table import Call, Memory
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
        self._vehicles_vary = False  # whether gradients by the vehicles may be wanted
        self._flights: dict[tuple[int, bool], _Flight] = {}

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
        if is_torch_array(body):
            return self._of_tensors(c, terms, body, thrust, targets, time, h)
        steps = self._steps_of(c, terms, h)
        if steps is None or not steps.compiled:
            return runge_kutta_steps(c, terms, body, thrust, targets, time, h)
        return self._run(steps, body, thrust, targets, time)

    def _of_tensors(
        self,
        c: Coefficients,
        terms: ActiveTerms,
        body: Array,
        thrust: Array,
        targets: list[Array],
        time: Array,
        h: float,
    ) -> tuple[Array, Array]:
        import torch  # here and below, not above: numpy needs none of it

        from auv_torchrl.physics.kernel.tensors import DifferentiableSteps, differentiated, in_plain_memory

        steps = None
        if in_plain_memory(body, thrust, time, *targets) and not differentiated(time):
            steps = self._steps_of(c, terms, h)
        if steps is None or not steps.compiled or (self._vehicles_vary and torch.is_grad_enabled()):
            return runge_kutta_steps(c, terms, body, thrust, targets, time, h)
        if differentiated(body, thrust, *targets):
            return DifferentiableSteps.apply(steps, body, thrust, torch.stack(targets, dim=-2), time)
        later = self._run(steps, body, thrust, targets, time)
        return torch.from_numpy(later[0]), torch.from_numpy(later[1])

    def _run(self, steps: Steps, body: Array, thrust: Array, targets: list[Array], time: Array) -> tuple[Array, Array]:
        one = all(target is targets[0] for target in targets)
        target = np.asarray(targets[0])[:, None] if one else np.stack([np.asarray(goal) for goal in targets], axis=-2)
        return self._flight(steps, len(targets), one).run(body=body, thrust=thrust, target=target, time=time)

    def _steps_of(self, c: Coefficients, terms: ActiveTerms, h: float) -> Steps | None:
        """Steps of vehicles with these coefficients; None where these cannot be read."""
        if self._read is None or self._read[0] is not c or self._read[1] != h:
            self._read, self._steps = (c, h), None
            self._flights.clear()
            self._vehicles_vary = is_torch_array(c.lag) and any(field.requires_grad for field in c)
            if _is_readable(c):
                known = c.numpy() if is_torch_array(c.lag) else c
                self._steps = Steps(known, terms, h, Variant.of(known))
        return self._steps

    def _flight(self, steps: Steps, parts: int, one: bool) -> "_Flight":
        if (parts, one) not in self._flights:
            self._flights[parts, one] = _Flight(steps, parts, one)
        return self._flights[parts, one]


def _is_readable(c: Coefficients) -> bool:
    if not is_torch_array(c.lag):
        return True
    from auv_torchrl.physics.kernel.tensors import in_plain_memory

    return in_plain_memory(*c)


class _Flight:
    """Steps of the same vehicles (R,) again and again, their coefficients read once.

    Args:
        steps: of the vehicles.
        parts: Runge-Kutta steps P of a call.
        one: whether all of them have the same targets.
    """

    def __init__(self, steps: Steps, parts: int, one: bool):
        rows, thrusters = steps.c.full_thrust.shape
        self._dtype = steps.dtype
        body, thrust, time = (np.empty((1, rows, size), steps.dtype) for size in (13, thrusters, 1))
        arrays = {
            "constants": steps.constants,
            "body": body,
            "thrust": thrust,
            "time": time,
            "target": np.empty((1, rows, 1, 1 if one else parts, thrusters), steps.dtype),
            "force": np.zeros((1, 1, 1, 6), steps.dtype),
            "states": body[:, :, None],
            "final body": body,
            "final thrust": thrust,
            "final time": np.empty_like(time),
        }
        memory = Memory(rows, steps.code.kept, steps.dtype)
        self._call = Call(steps.code, steps.layout, arrays, (1, rows, 1, parts), memory)

    def run(self, **given: Array) -> tuple[Array, Array]:
        """Body (R, 13) and thrust (R, n) after steps from ``body``, ``thrust`` and ``time`` (R,) to ``target``.

        The target is (R, P, n), or (R, 1, n) where it is the same for all.
        """
        given = {name: np.ascontiguousarray(array, self._dtype) for name, array in given.items()}
        body, thrust = np.empty_like(given["body"]), np.empty_like(given["thrust"])
        self._call.run({**given, "states": body, "final body": body, "final thrust": thrust})
        return body, thrust
