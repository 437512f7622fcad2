"""The plain simulator: the equations of motion and nothing else, on numpy or torch."""

from collections.abc import Callable

import torch

from auv_torchrl.physics import ActiveTerms, Coefficients, State, control_step
from auv_torchrl.physics.step import runge_kutta_step
from auv_torchrl.scenario import Scenario
from auv_torchrl.simulator.arrays import Array, Arrays
from auv_torchrl.simulator.base import Simulator
from auv_torchrl.vehicle import Vehicle


class PlainSimulator(Simulator):
    """Vehicles moved by :func:`auv_torchrl.physics.control_step`.

    Args:
        vehicles: a batch of N, before the scenario acts.
        control_dt: s, for which each command is held.
        scenario: effects on top of each vehicle, by the time since it was placed; None for none.
        generator: of the sensors' noise; None for sensors without noise.
        arrays: the library that the state is kept in; numpy if not given.
        compiled: compile the Runge-Kutta step at its first use, some 10 s for each set of active terms; worth it
            for long runs of large fleets on torch. Needs a C++ compiler on the CPU.
    """

    def __init__(
        self,
        vehicles: Vehicle,
        control_dt: float,
        scenario: Scenario | None = None,
        generator: torch.Generator | None = None,
        arrays: Arrays | None = None,
        compiled: bool = False,
    ) -> None:
        super().__init__(vehicles, control_dt, scenario, generator, arrays)
        self._runge_kutta_step: Callable[..., tuple[Array, Array]] = (
            torch.compile(runge_kutta_step, fullgraph=True) if compiled else runge_kutta_step
        )

    def _advance(self, c: Coefficients, terms: ActiveTerms, command: Array) -> State:
        return control_step(c, terms, self.state, command, self.control_dt, advance=self._runge_kutta_step)
