"""The force that makes a free body of another simulator move as Fossen's equations say, on numpy or torch."""

from typing import Any

from array_api_compat import array_namespace

from auv_torchrl.physics.coefficients import ActiveTerms, Coefficients
from auv_torchrl.physics.hydrodynamics import acceleration
from auv_torchrl.physics.kinematics import cross, matvec, rotation_matrix

Array = Any


def free_body_force(
    c: Coefficients,
    terms: ActiveTerms,
    inertia: Array,
    fastest: Array | float,
    position: Array,
    rate: Array,
    rotation: Array,
    wrench: Array,
) -> tuple[Array, Array]:
    """Generalized force (..., 6) on a body without forces of its own, and whether its acceleration is sane (...).

    A body whose accelerations sum up to ``fastest`` or more, or to no number, has diverged: no force acts on it.

    Args:
        c: coefficients of the vehicles.
        terms: the terms that do anything for them.
        inertia: (6,) mass in kg and principal inertia in kg m^2 that the other simulator divides by, isotropic.
        fastest: m/s^2 and rad/s^2.
        position: (..., 3) in m, earth NED.
        rate: (..., 6) velocity along the axes of the earth in m/s, angular velocity in the body frame in rad/s.
        rotation: (..., 3, 3) from body to earth.
        wrench: (..., 6) in N and N m, from the thrusters.
    """
    xp = array_namespace(rate)
    linear, spin = matvec(rotation.mT, rate[..., :3]), rate[..., 3:]
    rates = acceleration(c, terms, rotation, position, xp.concat((linear, spin), axis=-1), wrench)
    sane = xp.sum(xp.abs(rates), axis=-1) < fastest
    over_ground = matvec(rotation, rates[..., :3] + cross(spin, linear))
    force = xp.concat((over_ground, rates[..., 3:]), axis=-1) * inertia
    return xp.where(sane[..., None], force, xp.zeros_like(force)), sane


def body_velocity(pose: Array, rate: Array) -> Array:
    """Velocity (..., 6) in the body frame of bodies with ``pose`` (..., 7), position and quaternion, and ``rate``.

    The rate (..., 6) is the velocity along the axes of the earth in m/s, and the angular velocity in the body frame.
    """
    linear = matvec(rotation_matrix(pose[..., 3:]).mT, rate[..., :3])
    return array_namespace(rate).concat((linear, rate[..., 3:]), axis=-1)
