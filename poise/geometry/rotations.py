"""Rotation matrices: from and to quaternions, about an axis, between two vectors; cross-product matrices."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from poise.geometry.vectors import plane_axes
from poise.types import Array, Mask


def rotation_of_quaternion(quaternion: ArrayLike) -> Array:
    """(..., 3, 3) rotations of quaternions (..., 4) x y z w of any length; NaN for zero or non-finite quaternions."""
    values = np.asarray(quaternion, dtype=np.float64)
    with np.errstate(over="ignore"):
        length = np.linalg.norm(values, axis=-1)
    valid = (length > 0) & np.isfinite(length)
    rotation = np.full((*length.shape, 3, 3), np.nan)
    if np.any(valid):
        rotation[valid] = Rotation.from_quat(values[valid]).as_matrix()
    return rotation


def quaternion_of_rotation(rotation: ArrayLike) -> Array:
    """(..., 4) unit quaternions x y z w, w not negative, of rotation matrices (..., 3, 3)."""
    matrices = np.asarray(rotation, dtype=np.float64)
    quaternion = Rotation.from_matrix(matrices.reshape(-1, 3, 3)).as_quat(canonical=True)
    return np.asarray(quaternion.reshape(*matrices.shape[:-2], 4))


def rotation_about(axis: ArrayLike, angle: float) -> Array:
    """(3, 3) rotation by an angle, rad, about a unit axis (3,) (Rodrigues; thesis eq. 5.17)."""
    return np.asarray(Rotation.from_rotvec(angle * np.asarray(axis, dtype=np.float64)).as_matrix())


def rotation_between(start: Array, end: Array) -> Array:
    """(3, 3) the smallest rotation that turns one unit vector (3,) into another."""
    cosine = float(start @ end)
    if cosine < -1 + 1e-12:
        return rotation_about(plane_axes(start)[0], np.pi)
    skew = cross_matrix(np.cross(start, end))
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
