"""What vehicles and effects need of numpy and of torch beyond the array API."""

from typing import Any

import numpy as np
from array_api_compat import array_namespace, device, is_torch_array

Array = Any


def like(array: Array) -> dict[str, Any]:
    """Keywords that make an array of the precision, and on the device, of another."""
    return {"dtype": array.dtype, "device": device(array)}


def converted(value: Any, to: Array) -> Array:
    """A number or an array as one of the library, the precision and the device of another; gradients flow on."""
    xp = array_namespace(to)
    if is_torch_array(value):
        return value.to(**like(to)) if is_torch_array(to) else host(value).astype(to.dtype)
    return xp.asarray(value, **like(to))


def host(array: Array) -> np.ndarray:
    """The same numbers as a numpy array; memory is shared where the array is on the CPU."""
    return array.detach().cpu().numpy() if is_torch_array(array) else np.asarray(array)


def diagonal_matrix(vector: Array) -> Array:
    """Matrices (..., k, k) with vectors (..., k) on their diagonals."""
    xp = array_namespace(vector)
    eye = xp.eye(vector.shape[-1], **like(vector))
    return xp.where(eye > 0, vector[..., None], xp.zeros_like(eye))


def copied(array: Array) -> Array:
    """A copy whose memory is its own, without gaps."""
    return array.contiguous().clone() if is_torch_array(array) else np.array(array)


def vector(*components: Array) -> Array:
    """One array (..., k) of k arrays (...)."""
    return array_namespace(*components).stack(components, axis=-1)


def joined(*parts: Array) -> Array:
    """Vectors (..., k) one behind the other along their last axis."""
    return array_namespace(*parts).concat(parts, axis=-1)
