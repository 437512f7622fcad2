"""What the surface of the water does: a hull that leaves it loses buoyancy and drag, a propeller thrust.

Above the surface a share ``c.air`` of the water's density is missing. Waves, added mass and the shift of the centre of
buoyancy are left out: the hull rights as it does in the water, as far as it is in the water.
"""

from typing import Any

from array_api_compat import array_namespace

from auv_torchrl.physics.coefficients import ActiveTerms, Coefficients
from auv_torchrl.physics.kinematics import cross, matvec

Array = Any
# A propeller gives all of its thrust deeper than ABOVE_FULL radii and none higher than BELOW_NONE radii: within 0.06 of
# the loss 1 - 0.675 (1 - 0.769 h/R)^1.258 of Minsaas, Faltinsen and Persson 1983.
PROPELLER_RADIUS = 0.038  # m, Blue Robotics T200: 76 mm across
FULL_BELOW, NONE_ABOVE = 1.3 * PROPELLER_RADIUS, 0.75 * PROPELLER_RADIUS  # m of depth and of height of its axis


def immersed(depth: Array, above: Array | float, below: Array | float) -> Array:
    """Share in [0, 1] that is in the water, where its middle is ``depth`` m deep: smooth from none to all.

    None is where it is ``above`` m above the surface, all where it is ``below`` m below. Within 0.05 of that of a
    cylinder that lies in the water.
    """
    xp = array_namespace(depth)
    share = (depth + above) / (above + below)
    share = xp.where(share > 0.0, share, xp.zeros_like(share))
    share = xp.where(share < 1.0, share, xp.ones_like(share))
    return share * share * (3.0 - 2.0 * share)


def dry_hull(c: Coefficients, rotation: Array, position: Array) -> Array:
    """Share in [0, 1] of buoyancy and drag that the hull lacks, (...): how far it is out, about its centre of buoyancy.

    Args:
        c: coefficients of the vehicles.
        rotation: (..., 3, 3) from body to earth.
        position: (..., 3) in m, earth NED.
    """
    xp = array_namespace(position)
    depth = position[..., 2] - c.surface + xp.sum(rotation[..., 2, :] * c.centre_of_buoyancy, axis=-1)
    half = c.hull_height / 2
    return c.air * (1.0 - immersed(depth, half, half))


def lost_buoyancy(c: Coefficients, dry: Array, down: Array) -> Array:
    """Force and moment (..., 6) in N and N m that a hull lacks of which a share ``dry`` is out of the water.

    ``down`` (..., 3) is earth z in the body frame.
    """
    xp = array_namespace(down)
    force = (dry * c.buoyancy)[..., None] * down
    return xp.concat((force, cross(c.centre_of_buoyancy + xp.zeros_like(force), force)), axis=-1)


def given_in_water(c: Coefficients, terms: ActiveTerms, thrust: Array, rotation: Array, position: Array) -> Array:
    """What of thrusts (..., n) in N thrusters give where they are, at or above the surface."""
    if not terms.surface:
        return thrust
    depth = (position[..., 2] - c.surface)[..., None] + matvec(c.thruster_position, rotation[..., 2, :])
    wet = 1.0 - c.air[..., None] * (1.0 - immersed(depth, NONE_ABOVE, FULL_BELOW))
    if terms.azimuth:  # a servo turns in air as well
        wet = array_namespace(wet).where(c.turns > 0, array_namespace(wet).ones_like(wet), wet)
    return thrust * wet
