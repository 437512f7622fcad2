"""What actuators push at a speed: a thruster as at rest, a fin by the flow, a servo by the thrust that it turns."""

from typing import Any

from array_api_compat import array_namespace

from auv_torchrl.physics.azimuths import azimuth_wrenches, servo_of
from auv_torchrl.physics.coefficients import ActiveTerms, Coefficients
from auv_torchrl.physics.fins import fin_forces
from auv_torchrl.physics.kinematics import cross, matvec

Array = Any
_STEP = 1e-4  # share of a full command, of the differences that give what it does


def wrench_per_share(c: Coefficients, terms: ActiveTerms, speed: float | Array = 0.0) -> Array:
    """Wrench (..., 6, n) in N and N m per full thrust or full deflection of each actuator, at a speed ahead in m/s.

    Of fins and servos it is the slope about no command, in still water; nothing where there is no speed. A servo turns
    a thruster that gives what keeps up the speed. Of speeds (...) it is that at each of them.
    """
    allocated = c.allocation * c.full_thrust[..., None, :]
    if not terms.servos:
        return allocated
    xp = array_namespace(c.full_thrust)
    speed = xp.zeros_like(c.full_thrust[..., 0]) + speed
    if terms.fins:
        allocated = allocated + _per_deflection(c, speed)
    return allocated + _per_turn(c, terms, speed) if terms.azimuth else allocated


def _per_deflection(c: Coefficients, speed: Array) -> Array:
    """Wrench (..., 6, n) per full deflection of each fin."""
    xp, still = array_namespace(speed), array_namespace(speed).zeros_like(speed)
    ahead, still = (xp.stack((first, still, still), axis=-1) for first in (speed, still))
    force = sum(sign * fin_forces(c, ahead, still, sign * _STEP * c.full_thrust) / (2 * _STEP) for sign in (1.0, -1.0))
    moment = cross(c.thruster_position, force)
    return xp.concat((force, moment), axis=-1).mT


def _per_turn(c: Coefficients, terms: ActiveTerms, speed: Array) -> Array:
    """Wrench (..., 6, n) per full angle of each servo, and what its offset changes per full thrust of its thruster."""
    xp = array_namespace(speed)
    none, is_servo = xp.zeros_like(c.turns), c.turns > 0
    stands = azimuth_wrenches(c, xp.where(is_servo, none, c.full_thrust)).mT
    steady, step = steady_thrust(c, terms, speed), xp.where(is_servo, _STEP * c.full_thrust, none)
    above, below = (azimuth_wrenches(c, steady + sign * step) for sign in (1.0, -1.0))
    return stands + ((above - below) / (2 * _STEP)).mT @ servo_of(c)


def steady_thrust(c: Coefficients, terms: ActiveTerms, speed: Array) -> Array:
    """Thrusts (..., n) in N, the least ones, that keep up speeds ahead (...) in m/s; before gains."""
    xp = array_namespace(speed)
    drag = c.linear_drag[..., 0, 0] * speed + c.quadratic_drag[..., 0] * speed * xp.abs(speed)
    if terms.surface:  # a hull that floats has drag as far as it is in the water
        floats = xp.minimum(c.restoring[..., 2, 2], xp.zeros_like(drag)) / c.buoyancy
        drag = drag * (1.0 + c.air * floats)
    ahead = c.allocation[..., 0, :]
    strength = xp.sum(ahead * ahead, axis=-1)
    per_unit = drag / xp.where(strength > 0, strength, xp.ones_like(strength))
    return xp.minimum(xp.maximum(per_unit[..., None] * ahead, -c.limit), c.limit)


def thrust_turned(c: Coefficients, terms: ActiveTerms, speed: Array) -> Array:
    """Thrust (..., n, n) that each servo turns, over that at a speed (...) in m/s, per share of each full thrust."""
    xp, by_servo = array_namespace(speed), servo_of(c).mT  # rows are servos
    steady = matvec(by_servo, steady_thrust(c, terms, speed))
    return by_servo * (
        c.full_thrust[..., None, :] / xp.where(steady != 0, steady, xp.full_like(steady, xp.inf))[..., None]
    )


def wrench_per_unit(c: Coefficients, terms: ActiveTerms, speed: float | Array = 0.0) -> Array:
    """Wrench (..., 6, n) in N and N m per newton of a thruster and radian of a servo; as :func:`wrench_per_share`."""
    return wrench_per_share(c, terms, speed) / c.full_thrust[..., None, :] if terms.servos else c.allocation
