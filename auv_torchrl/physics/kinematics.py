"""Rotations. Quaternions are (w, x, y, z) and turn body vectors into earth vectors, as in MuJoCo.

All functions are batch first and run on the array library of their inputs (numpy or torch).
"""

import math
from typing import Any

import numpy as np
from array_api_compat import array_namespace

from auv_torchrl.array_api import like

Array = Any


def matvec(matrix: Array, vector: Array) -> Array:
    """Product of ``(..., m, n)`` and ``(..., n)``; vectors that share a matrix are multiplied at once."""
    m, n = matrix.shape[-2:]
    lacks = vector.ndim - matrix.ndim + 1  # leading axes of the vectors that the matrices lack
    if lacks >= 0 and math.prod(matrix.shape[:-2]) == 1:
        return (matrix.reshape(m, n) @ vector.reshape(-1, n).T).T.reshape(*vector.shape[:-1], m)
    if lacks >= 0 and matrix.shape[-3] == 1:
        return vector @ matrix[..., 0, :, :].mT
    if lacks > 0:
        xp = array_namespace(vector)
        return xp.moveaxis(matrix @ xp.moveaxis(vector, 0, -1), -1, 0)
    if isinstance(vector, np.ndarray) and n == 3:  # column by column is three times as fast, and the same sum
        columns = (matrix[..., k] * vector[..., None, k] for k in range(n))
        return next(columns) + next(columns) + next(columns)
    if isinstance(vector, np.ndarray):
        return np.einsum("...mn,...n->...m", matrix, vector)  # numpy calls BLAS for each of many small products
    return (matrix @ vector[..., None])[..., 0]


def conjugate(quaternion: Array) -> Array:
    """The quaternion (..., 4) of the turn back."""
    return array_namespace(quaternion).concat((quaternion[..., :1], -quaternion[..., 1:]), axis=-1)


def cross(a: Array, b: Array) -> Array:
    """Vector product of ``(..., 3)`` and ``(..., 3)``."""
    xp = array_namespace(a, b)
    a1, a2, a3 = a[..., 0], a[..., 1], a[..., 2]
    b1, b2, b3 = b[..., 0], b[..., 1], b[..., 2]
    elements = xp.stack((a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1))
    return xp.permute_dims(elements, (*range(1, elements.ndim), 0))  # each element stays in one piece of memory


# E = [-v, w I + skew(v)] and G = [-v, w I - skew(v)] of a quaternion (w, v), Shabana 2013, Eq. 3.94 and 3.97: what each
# of w, x, y, z adds to their entries, (4, 3, 4)
_E, _G = np.array([
    [[[0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], [[0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]],
    [[[-1, 0, 0, 0], [0, 0, 0, -1], [0, 0, 1, 0]], [[-1, 0, 0, 0], [0, 0, 0, 1], [0, 0, -1, 0]]],
    [[[0, 0, 0, 1], [-1, 0, 0, 0], [0, -1, 0, 0]], [[0, 0, 0, -1], [-1, 0, 0, 0], [0, 1, 0, 0]]],
    [[[0, 0, -1, 0], [0, 1, 0, 0], [-1, 0, 0, 0]], [[0, 0, 1, 0], [0, -1, 0, 0], [-1, 0, 0, 0]]],
], float).swapaxes(0, 1)  # fmt: skip

_FACTORS = tuple(map(tuple, np.stack([_E, _G], axis=1).reshape(4, 24).tolist()))

# The rotation is E G^T and the rate of the quaternion G^T omega / 2. Their entries, and the square of the length, are
# sums of products of two of the seven numbers w, x, y, z, omega: which two, (22,) each, and which sums, (14, 22)
_SQUARES, _TURNING = np.triu_indices(4), np.indices((4, 3)).reshape(2, 12) + [[0], [4]]
_ONE, _OTHER = np.concatenate([_SQUARES, _TURNING], axis=1)
_WHOLE = np.concatenate([np.einsum("aik,bjk->abij", _E, _G).reshape(4, 4, 9), np.eye(4)[..., None]], axis=-1)
_SUMS = np.zeros((14, 22))
_SUMS[:10, :10] = ((_WHOLE + _WHOLE.swapaxes(0, 1)) / (1.0 + np.eye(4)[..., None]))[_SQUARES].T
_SUMS[10:, 10:] = 0.5 * _G.reshape(12, 4).T


def rotation_and_rate(quaternion: Array, angular_velocity: Array) -> tuple[Array, Array]:
    """Rotation from body to earth ``(..., 3, 3)``, and rate ``(..., 4)`` of the unit quaternion of this direction.

    The quaternion ``(..., 4)`` may have any length; the angular velocity ``(..., 3)`` is in rad/s, in the body frame.
    """
    if isinstance(quaternion, np.ndarray):  # calls BLAS for each of many small products, see matvec
        batch = quaternion.shape[:-1]
        numbers = np.concat((quaternion, angular_velocity), axis=-1).reshape(-1, 7).T
        sums = _SUMS.astype(numbers.dtype, copy=False) @ (numbers[_ONE] * numbers[_OTHER])
        square = sums[9]
        return (sums[:9] / square).T.reshape(*batch, 3, 3), (sums[10:] / np.sqrt(square)).T.reshape(*batch, 4)
    e, g = _factors(quaternion)
    return e @ g.mT, 0.5 * matvec(g.mT, angular_velocity)


def _factors(quaternion: Array) -> tuple[Array, Array]:
    """E and G ``(..., 3, 4)``."""
    xp, batch = array_namespace(quaternion), quaternion.shape[:-1]
    factors = normalise(quaternion) @ xp.asarray(_FACTORS, **like(quaternion))
    factors = factors.reshape(*batch, 2, 3, 4)
    return factors[..., 0, :, :], factors[..., 1, :, :]


def rotation_matrix(quaternion: Array) -> Array:
    """Rotation from body to earth, ``(..., 3, 3)``, of quaternions ``(..., 4)`` of any length."""
    if isinstance(quaternion, np.ndarray):
        return rotation_and_rate(quaternion, quaternion[..., 1:])[0]
    e, g = _factors(quaternion)
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
    w, x, y, z = (quaternion[..., i] for i in range(4))  # by components: a sum over an axis of four takes twice as long
    return quaternion / xp.sqrt(w * w + x * x + y * y + z * z)[..., None]


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
    return roll, pitch, heading_of(quaternion)


def heading_of(quaternion: Array) -> Array:
    """Yaw (ZYX) in rad alone, in (-pi, pi]."""
    w, x, y, z = (quaternion[..., i] for i in range(4))
    return array_namespace(quaternion).atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def wrap_angle(angle: Array) -> Array:
    """The same angle in (-pi, pi]."""
    xp = array_namespace(angle)
    return -xp.remainder(xp.pi - angle, 2 * xp.pi) + xp.pi


def least_turn(angle: Array) -> Array:
    """The same angle in [-pi, pi]; one that is there already stays the same to the last bit."""
    return angle - 2 * math.pi * array_namespace(angle).round(angle / (2 * math.pi))
