"""Rotation matrices: from and to quaternions, about an axis, between two vectors; cross-product matrices."""

import numpy as np
from numpy.typing import ArrayLike

from poise.geometry.vectors import cross, plane_axes
from poise.types import Array, Mask

_ROUNDING = 1e-12
"""Error of a rotation matrix that is left as it is."""


def rotation_of_quaternion(quaternion: ArrayLike) -> Array:
    """(..., 3, 3) rotations of quaternions (..., 4) x y z w of any length; NaN for zero or non-finite quaternions."""
    values = np.asarray(quaternion, dtype=np.float64)
    with np.errstate(over="ignore"):
        length = np.linalg.norm(values, axis=-1)
    valid = (length > 0) & np.isfinite(length)
    rotation = np.full((*length.shape, 3, 3), np.nan)
    if np.any(valid):
        rotation[valid] = _matrices(values[valid] / length[valid][:, None])
    return rotation


def quaternion_of_rotation(rotation: ArrayLike) -> Array:
    """(..., 4) unit quaternions x y z w, w not negative, of rotation matrices (..., 3, 3)."""
    matrices = np.asarray(rotation, dtype=np.float64)
    quaternion = _quaternions(matrices.reshape(-1, 3, 3))
    w, z, y, x = quaternion.T[::-1]
    # w positive, or the first of x, y, z that is not zero
    negative = (w < 0) | ((w == 0) & ((x < 0) | ((x == 0) & ((y < 0) | ((y == 0) & (z < 0))))))
    quaternion[negative] *= -1.0
    return np.asarray(quaternion.reshape(*matrices.shape[:-2], 4))


def _matrices(quaternion: Array) -> Array:
    """(N, 3, 3) of unit quaternions (N, 4)."""
    x, y, z, w = quaternion.T
    rows = [
        [x * x - y * y - z * z + w * w, 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), -x * x + y * y - z * z + w * w, 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), -x * x - y * y + z * z + w * w],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def _quaternions(matrices: Array) -> Array:
    """(N, 4) unit quaternions of matrices (N, 3, 3), each from its largest component (Markley 2008).

    Raises:
        ValueError: a determinant is not positive.
    """
    m = _orthonormal(matrices)
    diagonal = np.diagonal(m, axis1=1, axis2=2)
    trace = diagonal.sum(axis=1)
    choice = np.argmax(np.concatenate([diagonal, trace[:, None]], axis=1), axis=1)
    result = np.empty((len(m), 4))
    for i in range(3):
        own = choice == i
        j, k = (i + 1) % 3, (i + 2) % 3
        some = m[own]
        result[own, i] = 1 - trace[own] + 2 * some[:, i, i]
        result[own, j] = some[:, j, i] + some[:, i, j]
        result[own, k] = some[:, k, i] + some[:, i, k]
        result[own, 3] = some[:, k, j] - some[:, j, k]
    own = choice == 3
    some = m[own]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        result[own, i] = some[:, k, j] - some[:, j, k]
    result[own, 3] = 1 + trace[own]
    return np.asarray(result / np.linalg.norm(result, axis=1, keepdims=True))


def nearest_rotation(matrix: ArrayLike) -> Array:
    """(..., 3, 3) the proper rotations nearest to matrices: they maximise the trace of R^T M (Kabsch 1976)."""
    left, _, right = np.linalg.svd(np.asarray(matrix, dtype=np.float64))
    left[..., 2] *= np.sign(np.linalg.det(left @ right))[..., None]
    return np.asarray(left @ right)


def _orthonormal(matrices: Array) -> Array:
    """(N, 3, 3) the nearest rotations, where matrices are not rotations to rounding."""
    wrong = np.linalg.det(matrices) <= 0
    if wrong.any():
        raise ValueError(f"rotation matrix {int(np.argmax(wrong))} has a determinant that is not positive")
    error = np.abs(matrices @ np.swapaxes(matrices, 1, 2) - np.eye(3)).max(axis=(1, 2), initial=0.0)
    off = ~(error <= _ROUNDING)
    if not off.any():
        return matrices
    result = matrices.copy()
    result[off] = nearest_rotation(matrices[off])
    return result


def rotation_about(axis: ArrayLike, angle: float) -> Array:
    """(3, 3) rotation by an angle, rad, about a unit axis (3,) (Rodrigues; thesis eq. 5.17)."""
    return rotation_of_vector(angle * np.asarray(axis, dtype=np.float64))


def rotation_of_vector(vector: ArrayLike) -> Array:
    """(..., 3, 3) rotations of rotation vectors (..., 3): axis times angle, rad."""
    values = np.asarray(vector, dtype=np.float64)
    angle = np.linalg.norm(values, axis=-1, keepdims=True)
    quaternion = np.concatenate([np.sinc(angle / (2 * np.pi)) / 2 * values, np.cos(angle / 2)], axis=-1)
    return _matrices(quaternion.reshape(-1, 4)).reshape(*values.shape, 3)


def vector_of_rotation(rotation: ArrayLike) -> Array:
    """(..., 3) rotation vectors, of at most half a turn, of rotation matrices (..., 3, 3)."""
    quaternion = quaternion_of_rotation(rotation)
    half = np.arctan2(np.linalg.norm(quaternion[..., :3], axis=-1), quaternion[..., 3])[..., None]
    return np.asarray(quaternion[..., :3] * 2.0 / np.sinc(half / np.pi))


def rotation_between(start: Array, end: Array) -> Array:
    """(3, 3) the smallest rotation that turns one unit vector (3,) into another."""
    cosine = float(start @ end)
    if cosine < -1 + 1e-12:
        return rotation_about(plane_axes(start)[0], np.pi)
    skew = cross_matrix(cross(start, end))
    return np.asarray(np.eye(3) + skew + skew @ skew / (1 + cosine))


def are_rotations(matrices: Array, tolerance: float = 1e-3) -> Mask:
    """(...) bool: which matrices (..., 3, 3) are proper and orthonormal; False for NaN."""
    with np.errstate(invalid="ignore"):
        product = np.swapaxes(matrices, -1, -2) @ matrices
        error = np.abs(product - np.eye(3)).max(axis=(-1, -2), initial=0.0)
        return np.asarray((error < tolerance) & (np.linalg.det(matrices) > 0))


def cross_matrix(vector: Array) -> Array:
    """(..., 3, 3) [v]x of vectors (..., 3), so that [v]x u = v x u."""
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    matrix = np.zeros((*vector.shape, 3))
    matrix[..., 0, 1], matrix[..., 0, 2], matrix[..., 1, 2] = -z, y, -x
    matrix[..., 1, 0], matrix[..., 2, 0], matrix[..., 2, 1] = z, -y, x
    return matrix
