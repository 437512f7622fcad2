"""Accelerations of the body in the water: M nu_dot + C(nu_r) nu_r + D(nu_r) nu_r + g = tau (Fossen 2021, Eq. 6.4)."""

from typing import Any

from array_api_compat import array_namespace

from auv_torchrl.physics.coefficients import ActiveTerms, Coefficients
from auv_torchrl.physics.kinematics import cross, matvec
from auv_torchrl.physics.surface import dry_hull, lost_buoyancy

Array = Any


def acceleration(
    c: Coefficients, terms: ActiveTerms, rotation: Array, position: Array, velocity: Array, wrench: Array
) -> Array:
    """Rate of the body velocity, (..., 6), in m/s^2 and rad/s^2.

    Args:
        c: coefficients of the vehicles.
        terms: the terms that do anything for them.
        rotation: (..., 3, 3) from body to earth.
        position: (..., 3) in m, earth NED.
        velocity: (..., 6) in m/s and rad/s, body FRD, over ground.
        wrench: (..., 6) in N and N m, from the thrusters, as :func:`~auv_torchrl.physics.surface.given_in_water`.
    """
    xp = array_namespace(velocity)
    water = None
    relative = velocity
    if terms.current:
        water = matvec(rotation.mT, c.current)
        relative = xp.concat((velocity[..., :3] - water, velocity[..., 3:]), axis=-1)
    down = rotation[..., 2, :]
    resistance = drag(c, terms, relative)
    force = wrench + matvec(c.restoring, down)
    if terms.surface:
        dry = dry_hull(c, rotation, position)
        resistance = (1.0 - dry)[..., None] * resistance
        force = force + lost_buoyancy(c, dry, down)
    force = force - resistance
    if terms.tether:
        pull = matvec(rotation.mT, tether_force(c, position))
        force = force + xp.concat((pull, xp.zeros_like(pull)), axis=-1)
    if terms.coriolis:
        force = force - c.coriolis[..., None] * coriolis_force(c.mass_matrix, relative)
    rate = matvec(c.mass_inverse, force) if terms.coupled_mass else xp.linalg.diagonal(c.mass_inverse) * force
    if water is not None and terms.coriolis:
        turning = -c.coriolis[..., None] * cross(velocity[..., 3:], water)
        rate = rate + xp.concat((turning, xp.zeros_like(turning)), axis=-1)
    return rate


def drag(c: Coefficients, terms: ActiveTerms, relative: Array) -> Array:
    """D(nu_r) nu_r, (..., 6): linear with coupling, and quadratic per degree of freedom (Eq. 14), by its direction."""
    xp = array_namespace(relative)
    speed = xp.abs(relative)
    if terms.uneven_drag:
        speed = speed + c.drag_asymmetry * relative
    quadratic = c.quadratic_drag * speed
    if terms.coupled_drag:
        return matvec(c.linear_drag, relative) + quadratic * relative
    return (xp.linalg.diagonal(c.linear_drag) + quadratic) * relative


def coriolis_force(mass_matrix: Array, velocity: Array) -> Array:
    """C(nu) nu from the whole mass matrix, (..., 6), without power (Fossen 2021, Theorem 3.2)."""
    xp = array_namespace(velocity)
    momentum = matvec(mass_matrix, velocity)
    linear, angular = velocity[..., :3], velocity[..., 3:]
    force = cross(angular, momentum[..., :3])
    moment = cross(linear, momentum[..., :3]) + cross(angular, momentum[..., 3:])
    return xp.concat((force, moment), axis=-1)


def tether_force(c: Coefficients, position: Array) -> Array:
    """Pull of the tether in N, (..., 3) in the earth frame: a spring beyond the slack length, at the body origin."""
    xp = array_namespace(position)
    reach = c.tether_anchor - position
    square = xp.sum(reach * reach, axis=-1)
    length = xp.sqrt(xp.where(square > 1e-18, square, 1e-18))  # a gradient at the anchor, too
    stretch = length - c.tether_slack
    tension = c.tether_stiffness * xp.where(stretch > 0.0, stretch, 0.0)
    return (tension / length)[..., None] * reach
