"""The plain simulator: the equations of motion and nothing else, on numpy or torch."""

from collections.abc import Callable
from functools import partial
from typing import Unpack

import numpy as np

from auv_torchrl.physics import ActiveTerms, Advance, Coefficients, State, Targets, control_step
from auv_torchrl.physics.step import runge_kutta_step, runge_kutta_steps
from auv_torchrl.physics.thrusters import straight_through_targets
from auv_torchrl.simulator.arrays import Array
from auv_torchrl.simulator.base import Options, Simulator
from auv_torchrl.vehicle import Vehicle


class PlainSimulator(Simulator):
    """Vehicles moved by :func:`auv_torchrl.physics.control_step`; on torch all of it stays on the arrays' device.

    On the CPU the steps are compiled (:class:`auv_torchrl.physics.Advance`), unless they are differentiated.

    Args:
        vehicles, control_dt, options: of every :class:`Simulator`.
        compiled: let torch compile the Runge-Kutta step at its first use, some 10 s for each set of active terms; for
            large fleets on a GPU. Needs a C++ compiler on the CPU.
        straight_through: let gradients by commands pass limits and dead bands as if these were not there; on torch.
    """

    def __init__(
        self,
        vehicles: Vehicle,
        control_dt: float,
        *,
        compiled: bool = False,
        straight_through: bool = False,
        **options: Unpack[Options],
    ) -> None:
        self._steps = Advance()
        self._aim = straight_through_targets if straight_through else Targets(vehicles.thrusters)
        super().__init__(vehicles, control_dt, **options)
        self._advance_body: Callable[..., tuple[Array, Array]] = _compiled() if compiled else self._steps

    def _begin_phase(self, rows: np.ndarray, phase: int) -> None:
        super()._begin_phase(rows, phase)
        self._steps.forget()

    def _advance(self, c: Coefficients, terms: ActiveTerms, command: Array) -> State:
        return control_step(c, terms, self.state, command, self.control_dt, advance=self._advance_body, aim=self._aim)

    def cut_gradients(self) -> None:
        """Let no gradient flow back from here, on torch."""
        self.state = State(*(part.detach() for part in self.state))
        self.poses = self.poses.detach()


def _compiled() -> Callable[..., tuple[Array, Array]]:
    import torch  # here, not above: numpy needs none of it

    return partial(runge_kutta_steps, step=torch.compile(runge_kutta_step, fullgraph=True))
