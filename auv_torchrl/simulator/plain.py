"""The plain simulator: the equations of motion and nothing else, on numpy or torch."""

from collections.abc import Callable
from typing import Unpack

import torch

from auv_torchrl.physics import ActiveTerms, Coefficients, State, control_step
from auv_torchrl.physics.step import runge_kutta_step
from auv_torchrl.simulator.arrays import Array
from auv_torchrl.simulator.base import Options, Simulator
from auv_torchrl.vehicle import Vehicle


class PlainSimulator(Simulator):
    """Vehicles moved by :func:`auv_torchrl.physics.control_step`; on torch all of it stays on the arrays' device.

    Args:
        vehicles, control_dt, options: of every :class:`Simulator`.
        compiled: compile the Runge-Kutta step at its first use, some 10 s for each set of active terms; worth it
            for long runs of large fleets on torch. Needs a C++ compiler on the CPU.
    """

    def __init__(
        self, vehicles: Vehicle, control_dt: float, *, compiled: bool = False, **options: Unpack[Options]
    ) -> None:
        super().__init__(vehicles, control_dt, **options)
        self._runge_kutta_step: Callable[..., tuple[Array, Array]] = (
            torch.compile(runge_kutta_step, fullgraph=True) if compiled else runge_kutta_step
        )

    def _advance(self, c: Coefficients, terms: ActiveTerms, command: Array) -> State:
        return control_step(c, terms, self.state, command, self.control_dt, advance=self._runge_kutta_step)
