"""Thrust targets of a fleet by compiled code."""

from functools import cache
from typing import Any

from auv_torchrl.physics.coefficients import ActiveTerms, Coefficients
from auv_torchrl.physics.kernel.by_row import ByRow, RowFunction
from auv_torchrl.physics.thrusters import limited_thrust, thrust_targets

Array = Any


class Targets:
    """:func:`~auv_torchrl.physics.thrusters.thrust_targets`; compiled where thrust only follows the command just sent.

    Args:
        thrusters: of a vehicle.
    """

    def __init__(self, thrusters: int):
        self._limited = ByRow(_limited(thrusters))

    def __call__(
        self, c: Coefficients, terms: ActiveTerms, commands: Array, control_dt: float, stretches: int
    ) -> list[Array]:
        """As of the function."""
        if commands.shape[-2] > 1 or terms.routing or terms.curve:
            return thrust_targets(c, terms, commands, control_dt, stretches)
        return [self._limited(commands[..., 0, :], c.full_thrust, c.limit, c.dead_band)] * stretches


@cache
def _limited(thrusters: int) -> RowFunction:
    given = ("command", "full_thrust", "limit", "dead_band")
    return RowFunction("thrust", limited_thrust, dict.fromkeys(given, thrusters))
