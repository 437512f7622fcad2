"""Thrust targets of a fleet by compiled code."""

from typing import Any

from auv_torchrl.physics.coefficients import ActiveTerms, Coefficients
from auv_torchrl.physics.kernel.by_row import ByRow
from auv_torchrl.physics.thrusters import limited_thrust, thrust_targets

Array = Any


class Targets:
    """:func:`~auv_torchrl.physics.thrusters.thrust_targets`; compiled where thrust only follows the command just sent.

    Args:
        thrusters: of a vehicle.
    """

    def __init__(self, thrusters: int):
        given = ("command", "full_thrust", "limit", "dead_band")
        self._limited = ByRow("thrust", limited_thrust, dict.fromkeys(given, thrusters))

    def __call__(
        self, c: Coefficients, terms: ActiveTerms, commands: Array, control_dt: float, stretches: int
    ) -> list[Array]:
        """As of the function."""
        if commands.shape[-2] > 1 or terms.routing or terms.curve:
            return thrust_targets(c, terms, commands, control_dt, stretches)
        return [self._limited(commands[..., 0, :], c.full_thrust, c.limit, c.dead_band)] * stretches
