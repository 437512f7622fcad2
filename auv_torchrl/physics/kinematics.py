"""Rotations. Quaternions are (w, x, y, z) and turn body vectors into earth vectors, as in MuJoCo.

All functions are batch first and run on the array library of their inputs (numpy or torch).
"""

from typing import Any

from array_api_compat import array_namespace

Array = Any


def matvec(matrix: Array, vector: Array) -> Array:
    """Product of ``(..., m, n)`` and ``(..., n)``."""
    return (matrix @ vector[..., None])[..., 0]


def cross(a: Array, b: Array) -> Array:
    """Vector product of ``(..., 3)`` and ``(..., 3)``."""
    xp = array_namespace(a, b)
    a1, a2, a3 = a[..., 0], a[..., 1], a[..., 2]
    b1, b2, b3 = b[..., 0], b[..., 1], b[..., 2]
    return xp.stack((a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1), axis=-1)


# Rows w, x, y, z; columns the entries of E and G, (3, 4) each, of Shabana 2013, Eq. 3.94 and 3.97:
# E = [-v, w I + skew(v)], G = [-v, w I - skew(v)] for the vector part v
_FACTORS = (
    (0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1),
    (-1, 0, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, -1, 0, 0, 0, 0, 0, 0, 1, 0, 0, -1, 0),
    (0, 0, 0, 1, -1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 0, -1, -1, 0, 0, 0, 0, 1, 0, 0),
    (0, 0, -1, 0, 0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 0, -1, 0, 0, -1, 0, 0, 0),
)


def quaternion_factors(quaternion: Array) -> tuple[Array, Array]:
    """E and G, each ``(..., 3, 4)``: the rotation is E G^T, the rate of the quaternion G^T omega / 2."""
    xp = array_namespace(quaternion)
    table = xp.asarray(_FACTORS, dtype=quaternion.dtype, device=quaternion.device)
    both = xp.reshape(quaternion @ table, (*quaternion.shape[:-1], 2, 3, 4))
    return both[..., 0, :, :], both[..., 1, :, :]


def rotation_matrix(quaternion: Array) -> Array:
    """Rotation from body to earth, ``(..., 3, 3)``, of unit quaternions ``(..., 4)``."""
    e, g = quaternion_factors(quaternion)
    return e @ g.mT


def quaternion_product(a: Array, b: Array) -> Array:
    """Hamilton product of ``(..., 4)`` and ``(..., 4)``."""
    xp = array_namespace(a, b)
    aw, ax, ay, az = (a[..., i] for i in range(4))
    bw, bx, by, bz = (b[..., i] for i in range(4))
    elements = (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )
    return xp.stack(elements, axis=-1)


def normalise(quaternion: Array) -> Array:
    """Unit quaternion of the same direction."""
    xp = array_namespace(quaternion)
    return quaternion / xp.sqrt(xp.sum(quaternion * quaternion, axis=-1, keepdims=True))


def quaternion_from_euler(roll: Array, pitch: Array, yaw: Array) -> Array:
    """Quaternion of ZYX Euler angles in rad."""
    xp = array_namespace(roll, pitch, yaw)
    cr, sr = xp.cos(roll / 2), xp.sin(roll / 2)
    cp, sp = xp.cos(pitch / 2), xp.sin(pitch / 2)
    cy, sy = xp.cos(yaw / 2), xp.sin(yaw / 2)
    elements = (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
    return xp.stack(elements, axis=-1)


def euler_angles(quaternion: Array) -> tuple[Array, Array, Array]:
    """Roll, pitch and yaw (ZYX) in rad; pitch in [-pi/2, pi/2], the others in (-pi, pi]."""
    xp = array_namespace(quaternion)
    w, x, y, z = (quaternion[..., i] for i in range(4))
    roll = xp.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = xp.asin(xp.clip(2 * (w * y - x * z), -1.0, 1.0))
    yaw = xp.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return roll, pitch, yaw


def wrap_angle(angle: Array) -> Array:
    """The same angle in (-pi, pi]."""
    xp = array_namespace(angle)
    return -xp.remainder(xp.pi - angle, 2 * xp.pi) + xp.pi
