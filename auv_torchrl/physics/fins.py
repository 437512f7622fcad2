"""Lift and drag of fins on the local flow, with stall.

A fin is an actuator among the thrusters that has an area. Where a thruster has its thrust in N, a fin has its
deflection in rad, with the same commands, delay, routing, limit and lag; it pushes with the flow alone.

The flow is that at the fin: of the body through the water, and of its turning. With the angle of attack a, the chord
turned by the deflection, and s falling from 1 to 0 about the stall angle, the coefficients are

    lift  sin a cos a (c_L s + c_n (1 - s))      drag  c_D + (c_L s sin a cos a)^2 / (pi A) + c_n (1 - s) sin^2 a

with c_L the slope of the lift, A the effective aspect ratio (induced drag, Hoerner 1965, section 7), and c_n that of a
plate across the flow, whose force is normal to it once the flow has left it. Lift is across the flow and does no work.
"""

import math
from typing import Any

from array_api_compat import array_namespace

from auv_torchrl.physics.coefficients import ActiveTerms, Coefficients
from auv_torchrl.physics.kinematics import cross, matvec
from auv_torchrl.physics.surface import given_in_water
from auv_torchrl.vehicle.fields import WATER_DENSITY

Array = Any
ACROSS = 1.17  # of a square plate across the flow, Hoerner 1965, section 3
_SMALL = 1e-12  # m^2/s^2, square of a speed that pushes nothing


def fin_wrench(
    c: Coefficients, terms: ActiveTerms, rotation: Array, position: Array, velocity: Array, thrust: Array
) -> Array:
    """Force in N and moment in N m (..., 6) of all fins on the body.

    Args:
        c: coefficients of the vehicles.
        terms: the terms that do anything for them.
        rotation: (..., 3, 3) from body to earth.
        position: (..., 3) in m, earth NED.
        velocity: (..., 6) in m/s and rad/s, body FRD, over ground.
        thrust: (..., n), of which fins take theirs as deflections in rad, before gains.
    """
    xp = array_namespace(velocity)
    linear = velocity[..., :3]
    if terms.current:
        linear = linear - matvec(rotation.mT, c.current)
    force = fin_forces(c, linear, velocity[..., 3:], thrust)
    if terms.surface:
        wet = given_in_water(c, terms, xp.ones_like(thrust), rotation, position)
        force = wet[..., None] * force
    moment = cross(c.thruster_position, force)
    return xp.sum(xp.concat((force, moment), axis=-1), axis=-2)


def fin_forces(c: Coefficients, linear: Array, angular: Array, thrust: Array) -> Array:
    """Force in N of each actuator as a fin, (..., n, 3), body FRD: nothing of those without an area.

    Args:
        c: coefficients of the vehicles.
        linear: (..., 3) velocity through the water in m/s.
        angular: (..., 3) in rad/s.
        thrust: (..., n) deflections in rad, before gains.
    """
    xp = array_namespace(linear)
    through = linear[..., None, :] + cross(angular[..., None, :], c.thruster_position)
    ahead, aside = (xp.sum(through * axis, axis=-1) for axis in (c.fin_chord, c.direction))
    turned = c.gain * thrust + c.servo_offset
    cosine, sine = xp.cos(turned), xp.sin(turned)
    along, across = (
        cosine * ahead + sine * aside,
        sine * ahead - cosine * aside,
    )  # of the chord; across: inflow below it
    square = ahead * ahead + aside * aside
    square = xp.where(square > _SMALL, square, xp.zeros_like(square) + _SMALL)
    speed = xp.sqrt(square)
    steep, both = across * across / square, across * along / square  # sin^2 and sin cos of the angle of attack
    stall = xp.sin(c.fin_stall)
    beyond = steep / (stall * stall)
    attached = 1.0 / (1.0 + (beyond * beyond) * (beyond * beyond))
    held = c.fin_lift * attached * both
    lift = held + ACROSS * (1.0 - attached) * both
    drag = c.fin_drag + held * held / (math.pi * c.fin_aspect) + ACROSS * (1.0 - attached) * steep
    pressure = 0.5 * WATER_DENSITY * c.fin_area * speed
    forward = pressure * (-lift * aside - drag * ahead)
    normal = pressure * (lift * ahead - drag * aside)
    return forward[..., None] * c.fin_chord + normal[..., None] * c.direction
