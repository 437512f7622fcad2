"""The push of azimuth thrusters: a servo among the actuators turns a thruster about an axis.

The servo has its angle in rad where a thruster has its thrust in N and a fin its deflection, with the same commands,
delay, routing, limit and lag. Its direction is the axis. With the unit axis a, the unit direction d of the thruster at
no angle, and its thrust T, turning by an angle b (positive about a, as a right hand turns) adds to the force T d

    T (sin b (a x d) + (cos b - 1) (d - a (a . d)))

(Rodrigues' formula). The force acts where the thruster sits at every angle: its line goes through the axis there. What
the water does to the housing of a thruster that is turned across the flow is left out.
"""

from typing import Any

from array_api_compat import array_namespace

from auv_torchrl.array_api import like
from auv_torchrl.physics.coefficients import Coefficients
from auv_torchrl.physics.kinematics import cross, matvec

Array = Any


def azimuth_wrench(c: Coefficients, thrust: Array) -> Array:
    """Force in N and moment in N m (..., 6) that turned thrusters give beyond those of their untouched directions.

    Args:
        c: coefficients of the vehicles.
        thrust: (..., n) in N of thrusters, in rad of servos, before gains.
    """
    return array_namespace(thrust).sum(azimuth_wrenches(c, thrust), axis=-2)


def azimuth_wrenches(c: Coefficients, thrust: Array) -> Array:
    """The same of each thruster, (..., n, 6): nothing of those that no servo turns."""
    xp, by_servo = array_namespace(thrust), servo_of(c)
    axis, angle = by_servo @ c.direction, matvec(by_servo, c.gain * thrust + c.servo_offset)
    along = xp.sum(axis * c.direction, axis=-1)[..., None]
    aside, across = cross(axis, c.direction), c.direction - along * axis
    turned = xp.sin(angle)[..., None] * aside + (xp.cos(angle) - 1.0)[..., None] * across
    force = (c.gain * thrust)[..., None] * turned
    moment = cross(c.thruster_position, force) + c.reaction[..., None] * force
    return xp.concat((force, moment), axis=-1)


def servo_of(c: Coefficients) -> Array:
    """Which servo turns which thruster, (..., n, n): 1 in the row of the thruster and the column of its servo."""
    xp = array_namespace(c.turns)
    numbers = xp.asarray([[row + 1.0] for row in range(c.turns.shape[-1])], **like(c.turns))
    off = xp.abs(c.turns[..., None, :] - numbers)
    return xp.where(off < 0.5, xp.ones_like(off), xp.zeros_like(off))
